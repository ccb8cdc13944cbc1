! The coupling protocol for solvers in Fortran: undine_link.h through iso_c_binding.
! SPDX-License-Identifier: BSD-3-Clause
!
! Same names, arguments and return codes as in undine_link.h; arrays are (dim, n) in Fortran's order, which is the
! rows-of-dim order of C. Node positions in face_nodes count from 0. Texts are ordinary character arguments.
module undine_link
  use, intrinsic :: iso_c_binding
  implicit none
  public

  integer(c_int), parameter :: undine_ok = 0, undine_end = -1, undine_checkpoint = -2
  integer(c_int), parameter :: undine_internal_error = 1, undine_numerical_error = 10

  type, bind(c) :: undine_setup
    integer(c_int32_t) :: dim = 0, n_interfaces = 0
    real(c_double) :: t_begin = 0, t_end = 0
  end type

  type, bind(c) :: undine_window
    integer(c_int64_t) :: index = 0, steps = 0
    real(c_double) :: t_begin = 0, t_end = 0
    integer(c_int32_t) :: fine = 0, activate = 0, output = 0, last = 0
  end type

  !> x is (dim, n_nodes); use c_f_pointer
  type, bind(c) :: undine_surface
    integer(c_int64_t) :: n_nodes = 0, n_faces = 0
    type(c_ptr) :: x = c_null_ptr, face_offset = c_null_ptr, face_nodes = c_null_ptr
  end type

  type, bind(c) :: undine_report
    real(c_double) :: stable_dt = 0, kinetic_energy = 0, internal_energy = 0, external_work = 0
    real(c_double) :: dissipated_energy = 0, interface_work = 0, mass = 0
    integer(c_int64_t) :: steps = 0
    integer(c_int32_t) :: surface_changed = 0, reserved = 0
  end type

  interface
    integer(c_int) function undine_comm_f(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    integer(c_int) function undine_in_contact(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    integer(c_int) function undine_receive_surface(link, surface) bind(c)
      import; type(c_ptr), value :: link; type(undine_surface) :: surface
    end function
    integer(c_int) function undine_receive_setup(link, setup) bind(c)
      import; type(c_ptr), value :: link; type(undine_setup) :: setup
    end function
    !> fixed is (dim, n): 1 where a component is prescribed
    integer(c_int) function undine_set_nodes(link, n, node_id, x, mass, fixed) bind(c)
      import; type(c_ptr), value :: link; integer(c_int64_t), value :: n
      integer(c_int64_t) :: node_id(*); real(c_double) :: x(*), mass(*); integer(c_int32_t) :: fixed(*)
    end function
    integer(c_int) function undine_set_nodes_with_matrix(link, n, node_id, x, inverse_mass) bind(c)
      import; type(c_ptr), value :: link; integer(c_int64_t), value :: n
      integer(c_int64_t) :: node_id(*); real(c_double) :: x(*), inverse_mass(*)
    end function
    integer(c_int) function undine_send_surface(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    !> every rank has wet nodes of its own; see undine_link.h
    integer(c_int) function undine_distribute(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    integer(c_int) function undine_send_report(link, report) bind(c)
      import; type(c_ptr), value :: link; type(undine_report) :: report
    end function
    integer(c_int) function undine_offer_checkpoints(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    !> C strings; c_null_ptr if there is none
    type(c_ptr) function undine_restart_folder(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    type(c_ptr) function undine_checkpoint_folder(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    !> zero-terminated; file_name = c_null_ptr: not written
    integer(c_int) function undine_checkpoint_done(link, file_name, reason) bind(c)
      import; type(c_ptr), value :: link, file_name, reason
    end function
    integer(c_int) function undine_next_window(link, window) bind(c)
      import; type(c_ptr), value :: link; type(undine_window) :: window
    end function
    integer(c_int) function undine_send_kinematics(link, v, a_free) bind(c)
      import; type(c_ptr), value :: link; real(c_double) :: v(*), a_free(*)
    end function
    integer(c_int) function undine_receive_activation(link, impulse, link_force) bind(c)
      import; type(c_ptr), value :: link; real(c_double) :: impulse(*), link_force(*)
    end function
    integer(c_int) function undine_send_free_velocity(link, v_free) bind(c)
      import; type(c_ptr), value :: link; real(c_double) :: v_free(*)
    end function
    integer(c_int) function undine_receive_link_force(link, link_force) bind(c)
      import; type(c_ptr), value :: link; real(c_double) :: link_force(*)
    end function
    integer(c_int) function undine_exchange(link, v_free, link_force) bind(c)
      import; type(c_ptr), value :: link; real(c_double) :: v_free(*), link_force(*)
    end function
    integer(c_int) function undine_send_motion(link, x, v) bind(c)
      import; type(c_ptr), value :: link; real(c_double) :: x(*), v(*)
    end function
    integer(c_int) function undine_ping(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    real(c_double) function undine_wait_seconds(link) bind(c)
      import; type(c_ptr), value :: link
    end function
    subroutine undine_close(link) bind(c)
      import; type(c_ptr), value :: link
    end subroutine
  end interface

  private :: to_fortran
  interface
    integer(c_int) function c_undine_arm(role, seconds) bind(c, name="undine_arm")
      import; character(kind=c_char) :: role(*); real(c_double), value :: seconds
    end function
    integer(c_int) function c_undine_open(link, role, solver, hello, stall) bind(c, name="undine_open")
      import; type(c_ptr) :: link; character(kind=c_char) :: role(*), solver(*)
      real(c_double), value :: hello, stall
    end function
    integer(c_int) function c_undine_open_force_in(link, role, solver, hello, stall) bind(c, name="undine_open_force_in")
      import; type(c_ptr) :: link; character(kind=c_char) :: role(*), solver(*)
      real(c_double), value :: hello, stall
    end function
    integer(c_int) function c_undine_open_contact(link, role, solver, hello, stall) bind(c, name="undine_open_contact")
      import; type(c_ptr) :: link; character(kind=c_char) :: role(*), solver(*)
      real(c_double), value :: hello, stall
    end function
    type(c_ptr) function c_undine_last_error(link) bind(c, name="undine_last_error")
      import; type(c_ptr), value :: link
    end function
    type(c_ptr) function c_undine_interface_name(link, i) bind(c, name="undine_interface_name")
      import; type(c_ptr), value :: link; integer(c_int32_t), value :: i
    end function
    integer(c_int) function c_undine_add_faces(link, name, n_faces, nodes_per_face, face_nodes) &
        bind(c, name="undine_add_faces")
      import; type(c_ptr), value :: link; character(kind=c_char) :: name(*)
      integer(c_int64_t), value :: n_faces; integer(c_int32_t), value :: nodes_per_face
      integer(c_int32_t) :: face_nodes(*)
    end function
    integer(c_int) function c_undine_add_faces_by_id(link, name, n_faces, nodes_per_face, node_ids) &
        bind(c, name="undine_add_faces_by_id")
      import; type(c_ptr), value :: link; character(kind=c_char) :: name(*)
      integer(c_int64_t), value :: n_faces; integer(c_int32_t), value :: nodes_per_face
      integer(c_int64_t) :: node_ids(*)
    end function
    integer(c_int) function c_undine_request_stop(link, reason) bind(c, name="undine_request_stop")
      import; type(c_ptr), value :: link; character(kind=c_char) :: reason(*)
    end function
    subroutine c_undine_abort(link, code, text, out_dir) bind(c, name="undine_abort")
      import; type(c_ptr), value :: link, text; integer(c_int), value :: code
      character(kind=c_char) :: out_dir(*)
    end subroutine
    integer(c_size_t) function c_string_length(text) bind(c, name="strlen")
      import; type(c_ptr), value :: text
    end function
  end interface

contains

  integer(c_int) function undine_arm(role, seconds)
    character(*), intent(in) :: role
    real(c_double), intent(in) :: seconds
    undine_arm = c_undine_arm(trim(role)//c_null_char, seconds)
  end function

  integer(c_int) function undine_open(link, role, solver, hello_seconds, stall_seconds)
    type(c_ptr), intent(out) :: link
    character(*), intent(in) :: role, solver
    real(c_double), intent(in) :: hello_seconds, stall_seconds
    undine_open = c_undine_open(link, trim(role)//c_null_char, trim(solver)//c_null_char, hello_seconds, stall_seconds)
  end function

  !> Level A
  integer(c_int) function undine_open_force_in(link, role, solver, hello_seconds, stall_seconds)
    type(c_ptr), intent(out) :: link
    character(*), intent(in) :: role, solver
    real(c_double), intent(in) :: hello_seconds, stall_seconds
    undine_open_force_in = c_undine_open_force_in(link, trim(role)//c_null_char, trim(solver)//c_null_char, &
                                                  hello_seconds, stall_seconds)
  end function

  !> Level B, also where contact opens and closes; ask undine_in_contact
  integer(c_int) function undine_open_contact(link, role, solver, hello_seconds, stall_seconds)
    type(c_ptr), intent(out) :: link
    character(*), intent(in) :: role, solver
    real(c_double), intent(in) :: hello_seconds, stall_seconds
    undine_open_contact = c_undine_open_contact(link, trim(role)//c_null_char, trim(solver)//c_null_char, &
                                                hello_seconds, stall_seconds)
  end function

  function undine_last_error(link) result(text)
    type(c_ptr), intent(in) :: link
    character(:), allocatable :: text
    text = to_fortran(c_undine_last_error(link))
  end function

  !> Name of interface i = 0, 1, ..., n_interfaces - 1
  function undine_interface_name(link, i) result(text)
    type(c_ptr), intent(in) :: link
    integer(c_int32_t), intent(in) :: i
    character(:), allocatable :: text
    text = to_fortran(c_undine_interface_name(link, i))
  end function

  !> face_nodes is (nodes_per_face, n_faces)
  integer(c_int) function undine_add_faces(link, interface_name, face_nodes)
    type(c_ptr), intent(in) :: link
    character(*), intent(in) :: interface_name
    integer(c_int32_t), intent(in) :: face_nodes(:, :)
    undine_add_faces = c_undine_add_faces(link, trim(interface_name)//c_null_char, size(face_nodes, 2, c_int64_t), &
                                          size(face_nodes, 1, c_int32_t), face_nodes)
  end function

  !> After undine_distribute; node_ids is (nodes_per_face, n_faces)
  integer(c_int) function undine_add_faces_by_id(link, interface_name, node_ids)
    type(c_ptr), intent(in) :: link
    character(*), intent(in) :: interface_name
    integer(c_int64_t), intent(in) :: node_ids(:, :)
    undine_add_faces_by_id = c_undine_add_faces_by_id(link, trim(interface_name)//c_null_char, &
                                                      size(node_ids, 2, c_int64_t), &
                                                      size(node_ids, 1, c_int32_t), node_ids)
  end function

  integer(c_int) function undine_request_stop(link, reason)
    type(c_ptr), intent(in) :: link
    character(*), intent(in) :: reason
    undine_request_stop = c_undine_request_stop(link, trim(reason)//c_null_char)
  end function

  !> Without a text: that of the last error
  subroutine undine_abort(link, code, text, out_dir)
    type(c_ptr), intent(in) :: link
    integer(c_int), intent(in) :: code
    character(*), intent(in), optional :: text, out_dir
    character(kind=c_char), allocatable, target :: words(:)
    character(:), allocatable :: folder
    type(c_ptr) :: text_or_null
    integer :: i
    text_or_null = c_null_ptr
    if (present(text)) then
      allocate (words(len_trim(text) + 1))
      do i = 1, len_trim(text)
        words(i) = text(i:i)
      end do
      words(size(words)) = c_null_char
      text_or_null = c_loc(words)
    end if
    folder = ''
    if (present(out_dir)) folder = trim(out_dir)
    call c_undine_abort(link, code, text_or_null, folder//c_null_char)
  end subroutine

  function to_fortran(text) result(copy)
    type(c_ptr), intent(in) :: text
    character(:), allocatable :: copy
    character(kind=c_char), pointer :: letters(:)
    integer :: i
    if (.not. c_associated(text)) then
      copy = ''
      return
    end if
    call c_f_pointer(text, letters, [c_string_length(text)])
    allocate (character(size(letters)) :: copy)
    do i = 1, size(letters)
      copy(i:i) = letters(i)
    end do
  end function
end module
