! SPDX-License-Identifier: MIT
!> Translation of messages to the terms of the caller's language, so that their advice applies there. Messages of the library use
!> names of modern Fortran.
module tandem_legacy_wording
    implicit none (type, external)
    private

    public :: in_words_of

    !> A phrase, and the phrases that replace it in C and in Fortran 77.
    type :: phrase_type
        character(len=72) :: modern
        character(len=72) :: c, f77
    end type phrase_type

    character(len=*), parameter :: or_unset = ' or did not set its complete value'
    type(phrase_type), parameter :: phrases(21) = [ &
        phrase_type('assemble the start, in a scene by [initial] assemble = true', &
            'let joints be open in tandem_define and call tandem_assemble', 'let joints be open in TDDEFN and call TDASSM'), &
        phrase_type(' (nearest_type, tandem linearise --near)', ' (tandem linearise --near, of a scene)', &
            ' (tandem linearise --near, of a scene)'), &
        phrase_type(' (tandem linearise without --near)', ' of up to 1000 coordinates', ' of up to 1000 coordinates'), &
        phrase_type('assemble the start', 'move them by tandem_assemble', 'move them by TDASSM'), &
        phrase_type('q0 and qd0', 'q and qd', 'Q and QD'), &
        phrase_type('associate it, or let evaluate provide it', 'give it by tandem_set_position_function or tandem_set_evaluate', &
            'give it by TDPOS, TDMOT or TDEVAL'), &
        phrase_type('; associate it', '; give it', '; give it'), &
        phrase_type('verify_model', 'tandem_check', 'TDCHCK'), &
        phrase_type('tandem check', 'tandem_check', 'TDCHCK'), &
        phrase_type('tandem_start or TDSTRT', 'tandem_start', 'TDSTRT'), &
        phrase_type('continue with tandem resume, or run again', 'integrate again', 'integrate again'), &
        phrase_type('use a state saved by save_state of this version', 'use a state saved by tandem_save_state of this version', &
            'use a state saved by TDSAVE of this version'), &
        phrase_type('set up the simulation as when it was saved', 'set up the problem as when it was saved', &
            'set up the problem as when it was saved'), &
        phrase_type('the same model, options, start and events', 'the same model, options and events', &
            'the same model, options and events'), &
        phrase_type('pass this object to integrate as the observer of the complete run', &
            'integrate to the end passed to tandem_watch_error', 'integrate to the end passed to TDWERR'), &
        phrase_type('tandem_watch_error or TDWERR', 'tandem_watch_error', 'TDWERR'), &
        phrase_type('tandem_new_mechanism or TDMECH', 'tandem_new_mechanism', 'TDMECH'), &
        phrase_type('tandem_define or TDDEFN', 'tandem_define', 'TDDEFN'), &
        ! Values that were not set are detected only for procedures in another language.
        phrase_type('a model procedure requested a stop', 'a model procedure requested a stop'//or_unset, &
            'a model procedure requested a stop'//or_unset), &
        ! Likewise for an undefined status, such as that of a Python procedure that has raised an exception.
        phrase_type('could not be evaluated at a point', 'could not be evaluated'//or_unset//' at a point', &
            'could not be evaluated'//or_unset//' at a point'), &
        phrase_type('returned a negative status', 'returned a negative status'//or_unset, 'returned a negative status'//or_unset)]

contains

    !> Translate a message for C or Fortran 77.
    pure subroutine in_words_of(is_c, message)
        logical, intent(in) :: is_c
        character(len=:), allocatable, intent(inout) :: message
        integer :: at, i

        do i = 1, size(phrases)
            at = index(message, trim(phrases(i)%modern))
            if (at == 0) cycle
            message = message(:at - 1)//trim(merge(phrases(i)%c, phrases(i)%f77, is_c))// &
                message(at + len_trim(phrases(i)%modern):)
        end do
    end subroutine in_words_of
end module tandem_legacy_wording
