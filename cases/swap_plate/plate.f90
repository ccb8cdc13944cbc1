! A plate on springs as a solid of its own, in Fortran: the smallest program behind the coupling protocol.
program plate
  use undine_link
  use mpi
  implicit none
  integer, parameter :: n = 9 ! nodes along the plate
  real(c_double), parameter :: width = 0.1d0, m = 1000, k = 1d9, g = -10 ! [m], [kg/m2], [N/m3], [m/s2]
  real(c_double) :: x(2, n) = 0, length(n), mass(n), spring(n), dt
  real(c_double) :: u(2, n) = 0, v(2, n) = 0, a(2, n) = 0, f(2, n), p(2, n)
  integer(c_int32_t) :: fixed(2, n), faces(2, n - 1)
  integer(c_int64_t) :: id(n), j
  type(c_ptr) :: link
  type(undine_setup) :: setup
  type(undine_window) :: w
  type(undine_report) :: report
  character(4096) :: out = '.'
  integer(c_int) :: code
  integer :: i, history, status

  if (command_argument_count() >= 3) call get_command_argument(3, out) ! plate case.toml --out DIR
  code = undine_arm('solid', 60d0)
  call MPI_Init(status)
  call try(undine_open(link, 'solid', 'plate in Fortran', 60d0, 300d0))
  call try(undine_receive_setup(link, setup))

  length = width/(n - 1)
  length([1, n]) = length([1, n])/2
  mass = m*length
  spring = k*length
  id = [(i, i=0, n - 1)]
  x(1, :) = width*id/(n - 1)
  fixed(1, :) = 1
  fixed(2, :) = 0
  a(2, :) = g ! at rest, springs relaxed
  faces = reshape([(i, i - 1, i=1, n - 1)], [2, n - 1]) ! the plate lies to the left, below
  call try(undine_set_nodes(link, int(n, c_int64_t), id, x, mass, fixed))
  call try(undine_add_faces(link, 'wet', faces))
  call try(undine_send_surface(link))

  open (newunit=history, file=trim(out)//'/history/interface.csv', iostat=status)
  if (status /= 0) call undine_abort(link, 11, 'cannot write history/interface.csv', out)
  write (history, '(a)') 't[s],u_y[m],v_y[m/s]'
  write (history, '(es16.9e3,2(",",es24.16e3))') setup%t_begin, 0d0, 0d0
  report%mass = sum(mass)
  report%stable_dt = 0.9d0*2/sqrt(k/m)
  call try(undine_send_report(link, report))
  do
    code = undine_next_window(link, w)
    if (code == undine_end) exit
    call try(code)
    dt = (w%t_end - w%t_begin)/w%steps
    if (w%activate /= 0) then
      call try(undine_send_kinematics(link, v, a))
      call try(undine_receive_activation(link, p, f))
      v(2, :) = v(2, :) + p(2, :)/mass
      a(2, :) = a(2, :) + f(2, :)/mass
    end if
    do j = 1, w%steps
      v = v + 0.5d0*dt*a
      u = u + dt*v
      a(2, :) = g - spring*u(2, :)/mass
      v = v + 0.5d0*dt*a
      if (w%fine == 0 .and. j < w%steps) cycle
      call try(undine_exchange(link, v, f))
      a(2, :) = a(2, :) + f(2, :)/mass
      v(2, :) = v(2, :) + 0.5d0*dt*f(2, :)/mass
    end do
    report%steps = report%steps + w%steps
    report%kinetic_energy = 0.5d0*sum(mass*v(2, :)**2)
    report%internal_energy = 0.5d0*sum(spring*u(2, :)**2)
    report%external_work = g*sum(mass*u(2, :))
    write (history, '(es16.9e3,2(",",es24.16e3))') w%t_end, u(2, n/2 + 1), v(2, n/2 + 1)
    flush (history)
    call try(undine_send_report(link, report))
  end do
  close (history)
  call undine_close(link)
  call MPI_Finalize(status)

contains

  subroutine try(result)
    integer(c_int), intent(in) :: result
    if (result /= undine_ok) call undine_abort(link, result, out_dir=out)
  end subroutine
end program
