! SPDX-License-Identifier: MIT
!> The lexer of toml-f without its dates: no key of a scene takes one, and toml-f 0.5.1 reads behind the end of a time that is
!> shorter than a date.
module tandem_io_scene_lexer
    use tomlf, only: toml_datetime
    use tomlf_de_lexer, only: toml_lexer, toml_token
    implicit none (type, external)
    private

    public :: scene_lexer_type

    type, extends(toml_lexer) :: scene_lexer_type
    contains
        procedure :: extract_datetime
    end type scene_lexer_type

contains

    !> A date or a time keeps its type, by which it is refused, and has no value.
    subroutine extract_datetime(lexer, token, val)
        class(scene_lexer_type), intent(in) :: lexer
        type(toml_token), intent(in) :: token
        type(toml_datetime), intent(out) :: val
    end subroutine extract_datetime
end module tandem_io_scene_lexer
