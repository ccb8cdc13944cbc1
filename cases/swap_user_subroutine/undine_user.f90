! User subroutines that put an explicit code with VEXTERNALDB and VUAMP (Abaqus/Explicit) behind the coupling protocol at level A:
! concentrated forces in, sensors of displacement and velocity out. See README.md for the input file that belongs to it.
module undine_user
  use undine_link
  use mpi
  implicit none
  type(c_ptr) :: link
  type(undine_setup) :: setup
  type(undine_window) :: window
  type(undine_report) :: report
  character(1024) :: out = '.'
  real(c_double), allocatable :: x0(:, :), x(:, :), v(:, :), f(:, :) ! (dim, wet nodes)
  logical :: window_open = .false., ended = .false.
  real(c_double) :: last_length = 0

contains

  subroutine try(code)
    integer(c_int), intent(in) :: code
    if (code /= undine_ok) call undine_abort(link, code, out_dir=out)
  end subroutine

  !> Hand-shake, and the wet surface from the file "undine_surface.txt": n, faces, stable step; then per node coordinates and lumped
  !> mass; then per face the positions 1 ... n of its nodes, the body to the left (2-D) or counterclockwise from outside (3-D).
  subroutine begin()
    integer :: status, file, n, n_faces, k
    integer(c_int32_t), allocatable :: faces(:, :)
    integer(c_int64_t), allocatable :: id(:)
    integer(c_int32_t), allocatable :: fixed(:, :)
    real(c_double), allocatable :: mass(:)
    character(1024) :: surface
    integer(c_int) :: code
    call get_environment_variable('UNDINE_OUT', out)
    if (out == '') out = '.'
    call get_environment_variable('UNDINE_SURFACE', surface)
    if (surface == '') surface = 'undine_surface.txt'
    code = undine_arm('solid', 60d0)
    call MPI_Init(status)
    call try(undine_open_force_in(link, 'solid', 'user subroutines', 60d0, 300d0))
    call try(undine_receive_setup(link, setup))
    open (newunit=file, file=surface, status='old', action='read', iostat=status)
    if (status /= 0) call undine_abort(link, 4, 'cannot read '//trim(surface), out)
    read (file, *) n, n_faces, report%stable_dt
    allocate (x0(setup%dim, n), mass(n), faces(setup%dim, n_faces), id(n), fixed(setup%dim, n))
    do k = 1, n
      read (file, *) x0(:, k), mass(k)
    end do
    do k = 1, n_faces
      read (file, *) faces(:, k)
    end do
    close (file)
    id = [(k - 1, k=1, n)]
    fixed = 0
    allocate (x, source=x0)
    allocate (v, f, source=0*x0)
    call try(undine_set_nodes(link, int(n, c_int64_t), id, x0, mass, fixed))
    call try(undine_add_faces(link, undine_interface_name(link, 0), faces - 1))
    call try(undine_send_surface(link))
    call tell()
    call next_window()
  end subroutine

  !> State at a window's end
  subroutine tell()
    call try(undine_send_motion(link, x, v))
    call try(undine_send_report(link, report))
  end subroutine

  !> Orders and forces for the next window
  subroutine next_window()
    integer(c_int) :: code
    code = undine_next_window(link, window)
    window_open = code == undine_ok
    ended = code == undine_end
    if (ended) return
    call try(code)
    call try(undine_receive_link_force(link, f))
    last_length = window%t_end - window%t_begin
  end subroutine
end module

! The life of the analysis. lOp: 0 start of the analysis, 2 before an increment, when its length may be changed, 4 end of an
! increment, 6 end of the analysis. i_Array(5): 2 ends the analysis; r_Array: total time, step time, increment.
subroutine vexternaldb(lOp, i_Array, niArray, r_Array, nrArray)
  use undine_user
  include 'vaba_param.inc'
  dimension i_Array(niArray), r_Array(nrArray)
  integer :: status
  real(c_double) :: left
  select case (lOp)
  case (0)
    call begin()
  case (2)
    left = window%t_end - r_Array(1)
    if (left > 1d-9*last_length) then ! equal increments that end with the window
      r_Array(3) = left/ceiling(left/min(r_Array(3), 0.5d0*last_length)*(1 - 1d-12))
    else ! the window is over, VUAMP opens the next one in this increment: half of the last length cannot pass its end
      r_Array(3) = min(r_Array(3), 0.5d0*last_length)
    end if
  case (4)
    report%steps = report%steps + 1
    if (window_open .and. r_Array(1) > window%t_end + 1d-6*last_length) &
      call undine_abort(link, undine_numerical_error, 'an increment went beyond the window of the coupler', out)
  case (6)
    call undine_close(link)
    call MPI_Finalize(status)
  end select
  if (ended) i_Array(5) = 2
end subroutine

! One call per amplitude and increment, with all sensors: the state at the increment's begin. Amplitude F<k>_<i> is component i of
! the force on wet node k; sensors U<k>_<i> and V<k>_<i> are its displacement and velocity.
subroutine vuamp(ampName, time, ampValueOld, dt, nprops, props, nSvars, svars, lFlagsInfo, nSensor, sensorValues, sensorNames, &
                 jSensorLookUpTable, ampValueNew, lFlagsDefine, ampDerivative, ampSecDerivative, ampIncIntegral)
  use undine_user
  include 'vaba_param.inc'
  dimension time(2), lFlagsInfo(3), lFlagsDefine(5), sensorValues(nSensor), props(nprops), svars(nSvars), jSensorLookUpTable(*)
  character(80) :: sensorNames(nSensor), ampName
  integer :: s, node, component
  ampValueNew = 0
  if (lFlagsInfo(1) /= 0 .or. ended) return ! initialisation
  if (time(2) >= window%t_end - 1d-9*last_length) then
    do s = 1, nSensor
      call place(sensorNames(s), node, component)
      select case (sensorNames(s) (1:1))
      case ('U')
        x(component, node) = x0(component, node) + sensorValues(s)
      case ('V')
        v(component, node) = sensorValues(s)
      end select
    end do
    call tell()
    call next_window()
    if (ended) return
  end if
  call place(ampName, node, component)
  ampValueNew = f(component, node)

contains

  !> Node and component of a name such as F12_2
  subroutine place(name, node, component)
    character(80), intent(in) :: name
    integer, intent(out) :: node, component
    integer :: bar, status
    bar = index(name, '_')
    read (name(2:bar - 1), *, iostat=status) node
    if (status == 0) read (name(bar + 1:), *, iostat=status) component
    if (status /= 0) call undine_abort(link, 2, 'amplitude or sensor '//trim(name)//': write F, U or V, node, _, component', out)
  end subroutine
end subroutine
