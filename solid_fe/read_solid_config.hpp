// Reading of [solid], [[solid.fix]], [[solid.velocity]], [[solid.traction]] and the solid's part of
// [[interface]].
#pragma once

#include "common/config/case_file.hpp"
#include "solid_fe/solid_config.hpp"

namespace undine::solid
{

/// Read and validate everything the case says about the solid. `element_size` [m] is that of the run; the box
/// gets elements of about size_factor times it unless the case counts them.
/// Of several solids it reads the one that file.choose("solid", ...) took; `name` is that choice.
/// @throws InputError with place, key, value and rule
SolidConfig read_solid_config(const CaseFile& file, int dim, double element_size,
                              const std::string& name = "solid");

} // namespace undine::solid
