! SPDX-License-Identifier: MIT
!> Summary of a table of cases: means, extremes and histograms of columns, and Sobol' indices. Columns are read one at a time, so
!> that only one of them is in memory.
module tandem_io_sweep_summary
    use tandem, only: error_type, long, set_error, status_output_failed, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_sweep_random, only: random_words, stream_order
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: column_summary_type, index_type, read_column, summarise, sensitivities, bins

    !> Number of bins of a histogram.
    integer, parameter :: bins = 40
    !> Number of bootstrap samples for the confidence intervals of indices.
    integer, parameter :: resamples = 200

    !> Summary of a column, without failed cases.
    type :: column_summary_type
        !> Number of cases with a value.
        integer(long) :: n = 0
        !> Statistics of the values; NaN if there are none. The standard deviation is NaN for a single value too.
        real(wp) :: mean = 0.0_wp, deviation = 0.0_wp, least = 0.0_wp, most = 0.0_wp
        !> Cases with the smallest and the largest value.
        integer(long) :: case_of_least = 0, case_of_most = 0
        !> Number of cases in bins of equal width between the extremes.
        integer(long) :: histogram(bins) = 0
    end type column_summary_type

    !> First-order and total Sobol' index of an output for one input, with half the width of the interval that contains 95 % of the
    !> bootstrap samples.
    type :: index_type
        real(wp) :: first = 0.0_wp, total = 0.0_wp, first_error = 0.0_wp, total_error = 0.0_wp
    end type index_type

contains

    !> Read a column of a table, (width, cases).
    subroutine read_column(table, path, values, error)
        character(len=*), intent(in) :: table, path
        real(wp), allocatable, intent(out) :: values(:, :)
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file

        call file%open_to_read(table)
        call file%get(path, values)
        if (allocated(file%problem)) call set_error(error, status_output_failed, table//': '//file%problem)
        call file%close()
    end subroutine read_column

    !> Compute the summary of a column.
    pure subroutine summarise(values, summary)
        real(wp), intent(in) :: values(:)
        type(column_summary_type), intent(out) :: summary
        real(wp) :: square
        integer :: i, bin

        square = 0.0_wp
        do i = 1, size(values)
            if (.not. ieee_is_finite(values(i))) cycle
            summary%n = summary%n + 1
            if (summary%n == 1) then
                summary%least = values(i)
                summary%most = values(i)
                summary%case_of_least = i
                summary%case_of_most = i
            end if
            if (values(i) < summary%least) then
                summary%least = values(i)
                summary%case_of_least = i
            end if
            if (values(i) > summary%most) then
                summary%most = values(i)
                summary%case_of_most = i
            end if
            ! B. P. Welford, Technometrics 4 (1962) 419-420: avoids the difference of large sums.
            associate (change => values(i) - summary%mean)
                summary%mean = summary%mean + change/real(summary%n, wp)
                square = square + change*(values(i) - summary%mean)
            end associate
        end do
        summary%deviation = ieee_value(1.0_wp, ieee_quiet_nan)
        if (summary%n > 1) summary%deviation = sqrt(square/real(summary%n - 1, wp))
        if (summary%n == 0) then
            summary%mean = summary%deviation
            summary%least = summary%deviation
            summary%most = summary%deviation
            return
        end if
        do i = 1, size(values)
            if (.not. ieee_is_finite(values(i))) cycle
            bin = 1
            if (summary%most > summary%least) bin = 1 + int(bins*((values(i) - summary%least)/(summary%most - summary%least)))
            bin = min(bin, bins)
            summary%histogram(bin) = summary%histogram(bin) + 1
        end do
    end subroutine summarise

    !> Compute Sobol' indices from blocks of n + 2 cases: A, B, and copies of A with one coordinate of B each. First order: A.
    !> Saltelli et al., Comput. Phys. Commun. 181 (2010) 259-270, table 2 (b); total: M. J. W. Jansen, Comput. Phys. Commun. 117
    !> (1999) 35-43. Blocks with a failed case are ignored.
    pure subroutine sensitivities(values, n, seed, blocks, indices)
        real(wp), intent(in) :: values(:)
        !> Number of random inputs, and seed of the bootstrap.
        integer, intent(in) :: n, seed
        !> Number of complete blocks. With fewer than two, or without variance, the indices are NaN.
        integer, intent(out) :: blocks
        type(index_type), intent(out) :: indices(:)
        real(wp), allocatable :: whole(:, :), sample(:, :)
        real(wp) :: first(n), total(n)
        integer, allocatable :: chosen(:)
        integer(long) :: words(4)
        integer :: i, j, m

        m = size(values)/(n + 2)
        allocate (whole(n + 2, m))
        blocks = 0
        do i = 1, m
            associate (block => values((i - 1)*(n + 2) + 1:i*(n + 2)))
                if (.not. all(ieee_is_finite(block))) cycle
                blocks = blocks + 1
                whole(:, blocks) = block
            end associate
        end do
        allocate (sample(2*n, resamples), chosen(blocks))
        chosen = [(i, i=1, blocks)]
        call estimate(whole, chosen, first, total)
        indices%first = first
        indices%total = total
        do j = 1, resamples
            do i = 1, blocks
                words = random_words(seed, int(j, long), i, stream_order)
                chosen(i) = 1 + int(mod(words(1), int(max(1, blocks), long)))
            end do
            call estimate(whole, chosen, first, total)
            sample(:n, j) = first
            sample(n + 1:, j) = total
        end do
        do i = 1, n
            indices(i)%first_error = half_width(sample, i)
            indices(i)%total_error = half_width(sample, n + i)
        end do
    end subroutine sensitivities

    !> Evaluate the estimators for a selection of blocks. Subtracting the mean does not change their expectation but reduces their
    !> variance.
    pure subroutine estimate(whole, chosen, first, total)
        real(wp), intent(in) :: whole(:, :)
        integer, intent(in) :: chosen(:)
        real(wp), intent(out) :: first(:), total(:)
        real(wp) :: mean, variance
        integer :: i, j

        first = ieee_value(1.0_wp, ieee_quiet_nan)
        total = first
        if (size(chosen) < 2) return
        mean = sum(whole(1:2, chosen))/real(2*size(chosen), wp)
        variance = sum((whole(1:2, chosen) - mean)**2)/real(2*size(chosen), wp)
        if (.not. variance > 0.0_wp) return
        first = 0.0_wp
        total = 0.0_wp
        do i = 1, size(chosen)
            associate (block => whole(:, chosen(i)) - mean)
                do j = 1, size(first)
                    first(j) = first(j) + block(2)*(block(j + 2) - block(1))
                    total(j) = total(j) + (block(1) - block(j + 2))**2
                end do
            end associate
        end do
        first = first/(size(chosen)*variance)
        total = total/(2*size(chosen)*variance)
    end subroutine estimate

    !> Half the distance between the 2.5 % and the 97.5 % quantile of a sample.
    pure real(wp) function half_width(samples, row)
        real(wp), intent(in) :: samples(:, :)
        !> Row of the sample in `samples`.
        integer, intent(in) :: row
        real(wp) :: sorted(size(samples, 2)), value
        integer :: i, j

        sorted = samples(row, :)
        do i = 2, size(sorted)
            value = sorted(i)
            do j = i - 1, 1, -1
                if (sorted(j) <= value) exit
                sorted(j + 1) = sorted(j)
            end do
            sorted(j + 1) = value
        end do
        half_width = 0.5_wp*(sorted(ceiling(0.975_wp*size(sorted))) - sorted(max(1, floor(0.025_wp*size(sorted)))))
    end function half_width
end module tandem_io_sweep_summary
