! Stub of the product: calls VEXTERNALDB and VUAMP in the order of an explicit analysis, for a plate on springs (the one of
! cases/swap_plate). Its sensors show the displacement of an increment's begin and the velocity of half an increment before.
program product_stub
  implicit none
  integer, parameter :: n = 9, dp = kind(1d0)
  real(dp), parameter :: width = 0.1d0, m = 1000, k = 1d9, g = -10 ! [m], [kg/m2], [N/m3], [m/s2]
  real(dp) :: length(n), mass(n), spring(n), u(n) = 0, v(n) = 0, force(n), r_Array(3) = 0, dt, dt_before, value, none(5) = 0
  real(dp) :: sensors(2*n), times(2)
  integer :: i_Array(7) = 0, flags(3) = 0, defined(5) = 0, table(1) = 0, i, history
  character(80) :: names(2*n), amplitude
  character(1024) :: out
  external :: vexternaldb, vuamp

  if (command_argument_count() < 3) stop 'product_stub case.toml --out DIR' ! as scripts/run starts a solid
  call get_command_argument(3, out)
  length = width/(n - 1)
  length([1, n]) = length([1, n])/2
  mass = m*length
  spring = k*length
  do i = 1, n
    write (names(i), '(a,i0,a)') 'U', i, '_2'
    write (names(n + i), '(a,i0,a)') 'V', i, '_2'
  end do
  call write_surface()
  call vexternaldb(0, i_Array, 7, r_Array, 3)
  open (newunit=history, file=trim(out)//'/history/interface.csv')
  write (history, '(a,/,a)') 't[s],u_y[m],v_y[m/s]', '0,0,0'
  dt_before = 0
  do while (i_Array(5) == 0)
    r_Array(3) = 0.1d0/sqrt(k/m) ! its own stable increment, with a wide margin
    call vexternaldb(2, i_Array, 7, r_Array, 3)
    dt = r_Array(3)
    call vexternaldb(3, i_Array, 7, r_Array, 3)
    sensors = [u, v]
    times = r_Array([2, 1])
    do i = 1, n
      write (amplitude, '(a,i0,a)') 'F', i, '_2'
      call vuamp(amplitude, times, 0d0, dt, 0, none, 0, none, flags, 2*n, sensors, names, table, value, defined, none(1), none(2), &
                 none(3))
      force(i) = value
    end do
    v = v + 0.5d0*(dt + dt_before)*(g + (force - spring*u)/mass)
    u = u + dt*v
    dt_before = dt
    r_Array(1:2) = r_Array(1:2) + dt
    write (history, '(es16.9e3,2(",",es24.16e3))') r_Array(1), u(n/2 + 1), v(n/2 + 1)
    call vexternaldb(4, i_Array, 7, r_Array, 3)
  end do
  close (history)
  call vexternaldb(6, i_Array, 7, r_Array, 3)

contains

  !> What the user prepares from the model: see begin() in undine_user.f90
  subroutine write_surface()
    integer :: file, j
    character(1024) :: path
    path = trim(out)//'/undine_surface.txt'
    open (newunit=file, file=path)
    write (file, *) n, n - 1, 0.1d0/sqrt(k/m)
    do j = 1, n
      write (file, *) width*(j - 1)/(n - 1), 0d0, mass(j)
    end do
    do j = 1, n - 1
      write (file, *) j + 1, j
    end do
    close (file)
    call set('UNDINE_SURFACE', trim(path))
    call set('UNDINE_OUT', trim(out))
  end subroutine

  subroutine set(name, text)
    use, intrinsic :: iso_c_binding
    character(*), intent(in) :: name, text
    interface
      integer(c_int) function setenv(name, text, overwrite) bind(c)
        import; character(kind=c_char) :: name(*), text(*); integer(c_int), value :: overwrite
      end function
    end interface
    integer(c_int) :: code
    code = setenv(name//c_null_char, text//c_null_char, 1_c_int)
  end subroutine
end program
