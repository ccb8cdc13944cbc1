# What `cmake --install` puts where, and the Debian package that `cpack` makes of it.
#
#   bin/undine, undine-plot, undine-watch   scripts/run, plot, watch without the set-up
#   libexec/undine/                         the programs: coupler, fluid_pfem, solid_fe
#   share/undine/                           scripts and cases
#   share/doc/undine/                       README, docs
#   share/man/man1/                         a page per command and program, from their --help
# The protocol library is a component of its own (link), see common/coupling. Every place is found from that of the script, so that
# the tree may be moved.
include(GNUInstallDirs)
set(share ${CMAKE_INSTALL_DATADIR}/undine)

# Debian keeps parallel HDF5 and Open MPI in folders of their own, which the programs must go on knowing.
set_target_properties(coupler fluid_pfem solid_fe PROPERTIES INSTALL_RPATH_USE_LINK_PATH ON)
install(TARGETS coupler fluid_pfem solid_fe RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/undine)
install(PROGRAMS scripts/run_case.py scripts/plot scripts/watch DESTINATION ${share}/scripts)
install(FILES scripts/completion.bash DESTINATION ${share}/scripts)
install(DIRECTORY scripts/slurm DESTINATION ${share}/scripts)
install(DIRECTORY scripts/lib DESTINATION ${share}/scripts PATTERN __pycache__ EXCLUDE)
install(DIRECTORY cases DESTINATION ${share} PATTERN __pycache__ EXCLUDE PATTERN CMakeLists.txt EXCLUDE)
install(FILES README.md CHANGELOG.md CITATION.cff LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/undine)
install(DIRECTORY docs/ DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/undine)
set(man_pages ${CMAKE_BINARY_DIR}/install/man1)
add_custom_command(OUTPUT ${man_pages}/undine.1 DEPENDS scripts/man_pages scripts/run_case.py scripts/plot scripts/watch README.md
                   coupler fluid_pfem solid_fe undine-conform
                   COMMAND /usr/bin/python3 -B ${PROJECT_SOURCE_DIR}/scripts/man_pages ${CMAKE_RUNTIME_OUTPUT_DIRECTORY} ${man_pages})
add_custom_target(man_pages ALL DEPENDS ${man_pages}/undine.1)
install(DIRECTORY ${man_pages} DESTINATION ${CMAKE_INSTALL_MANDIR})
foreach(command IN ITEMS run_case.py=undine plot=undine-plot watch=undine-watch)
  string(REPLACE "=" ";" command ${command})
  list(GET command 0 SCRIPT)
  list(GET command 1 name)
  configure_file(cmake/command.in ${CMAKE_BINARY_DIR}/install/${name} @ONLY)
  install(PROGRAMS ${CMAKE_BINARY_DIR}/install/${name} DESTINATION ${CMAKE_INSTALL_BINDIR})
endforeach()
file(WRITE ${CMAKE_BINARY_DIR}/install/completion "[ -f /usr/${share}/scripts/completion.bash ] && . /usr/${share}/scripts/completion.bash\n")
install(FILES ${CMAKE_BINARY_DIR}/install/completion DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME undine)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME undine)
set(CPACK_PACKAGE_CONTACT "The Undine developers <undine@localhost>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "openmpi-bin, python3, python3-numpy, python3-matplotlib, python3-h5py, python3-pil")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "paraview, ffmpeg, gmsh")
set(CPACK_STRIP_FILES ON)
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
include(CPack)
