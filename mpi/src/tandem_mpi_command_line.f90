! SPDX-License-Identifier: MIT
!> tandem-mpi sweep: `tandem sweep` with the cases distributed over the ranks of MPI. A program that calls `mpi_command_line` with
!> its own models includes these.
module tandem_mpi_command_line
    use mpi_f08, only: mpi_abort, mpi_bcast, mpi_comm_rank, mpi_comm_world, mpi_finalize, mpi_init, mpi_integer
    use tandem, only: error_type
    use tandem_cli_arguments, only: arguments_type, read_arguments
    use tandem_cli_help, only: print_command_help
    use tandem_cli_messages, only: print_to_stderr, done, finish_output, input_wrong, signalled
    use tandem_cli_sweep, only: code_of, finish_sweep, prepare_sweep, sweep_setup_type
    use tandem_io, only: distribute, read_sweep, scene_model_type, shipped_models, words_of_record
    use tandem_mpi_ranks, only: ranks_type, relay
    implicit none (type, external)
    private

    public :: mpi_command_line

contains

    !> Execute the command line, on every rank.
    subroutine mpi_command_line(code, models)
        !> Exit code, equal on all ranks.
        integer, intent(out) :: code
        !> Models besides the shipped ones.
        type(scene_model_type), intent(in), optional :: models(:)
        type(arguments_type) :: arguments
        type(error_type), allocatable :: error
        integer :: rank

        call mpi_init()
        call mpi_comm_rank(mpi_comm_world, rank)
        if (present(models)) then
            arguments = read_arguments([models, shipped_models()])
        else
            arguments = read_arguments(shipped_models())
        end if
        code = input_wrong
        if (arguments%command /= 'sweep') then
            if (rank == 0) call print_to_stderr('tandem-mpi has one subcommand, sweep; the others are tandem''s')
        else
            call arguments%parse(error)
            if (allocated(error)) then
                if (rank == 0) call print_to_stderr(error%message)
            else if (arguments%help) then
                if (rank == 0) call print_command_help('sweep')
                code = done
            else
                call sweep(arguments, rank, code)
            end if
        end if
        if (rank == 0) call finish_output(code)
        ! Ranks that depend on others that have died would wait for ever.
        if (code > signalled) call mpi_abort(mpi_comm_world, code)
        call mpi_finalize()
    end subroutine mpi_command_line

    !> Run the sweep.
    subroutine sweep(arguments, rank, code)
        type(arguments_type), intent(in) :: arguments
        integer, intent(in) :: rank
        integer, intent(out) :: code
        type(sweep_setup_type), target :: setup
        type(error_type), allocatable :: error
        integer :: jobs

        code = done
        jobs = 1
        call arguments%count_of('--jobs', 4096, jobs, error)
        if (.not. allocated(error)) then
            if (rank == 0) then
                call prepare_sweep(arguments, setup, error)
            else
                call read_sweep(trim(arguments%scenes(1)), arguments%models, setup%plan, error)
                if (.not. allocated(error)) call setup%runner%prepare(setup%plan, arguments%models)
            end if
        end if
        if (allocated(error)) then
            code = code_of(error)
            if (rank == 0) call print_to_stderr(error%message)
        end if
        ! An error found by rank 0 ends all ranks.
        call mpi_bcast(code, 1, mpi_integer, 0, mpi_comm_world)
        if (code /= done) return
        if (rank == 0) then
            call lead(arguments, setup, jobs, error)
        else if (.not. allocated(error)) then
            call relay(setup%runner, jobs, words_of_record(setup%plan%n_outputs()), error)
        end if
        if (allocated(error)) then
            code = code_of(error)
            call print_to_stderr(error%message)
            ! The others wait for this rank.
            if (rank > 0) call mpi_abort(mpi_comm_world, code)
        end if
        if (code > signalled) return
        call mpi_bcast(code, 1, mpi_integer, 0, mpi_comm_world)
    end subroutine sweep

    !> Part of rank 0.
    subroutine lead(arguments, setup, jobs, error)
        type(arguments_type), intent(in) :: arguments
        type(sweep_setup_type), intent(inout), target :: setup
        integer, intent(in) :: jobs
        type(error_type), allocatable, intent(out) :: error
        type(ranks_type) :: team

        call team%prepare(setup%runner, jobs, words_of_record(setup%plan%n_outputs()))
        if (arguments%merges) then
            call team%dismiss()
        else
            call setup%progress%begin()
            call distribute(setup%journal, setup%plan%n_outputs(), setup%plan%max_seconds, team, setup%progress, error)
        end if
        if (.not. allocated(error)) call finish_sweep(arguments, setup, error)
        call setup%progress%clear()
        call setup%journal%close(.false.)
    end subroutine lead
end module tandem_mpi_command_line
