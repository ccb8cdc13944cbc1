// A thin wall drawn as a strip of quadrilaterals: where its fibres across the wall are, and the beam between
// them.
#pragma once

#include "common/mesh/mesh.hpp"
#include "solid_fe/beam.hpp"
#include "solid_fe/solid_config.hpp"

#include <array>
#include <vector>

namespace undine::solid
{

/// Fibre k is the straight line from node `ends[k][0]` to `ends[k][1]` of the mesh, through node k of the
/// beam.
struct Strip
{
  BeamConfig beam; ///< line, arms, thicknesses of the elements
  std::vector<std::array<index_t, 2>> ends;
};

/// Fibres are the edges that two quadrilaterals share and those opposite to them; of a single quadrilateral
/// the shorter pair of edges. @throws InputError if there are other elements than quadrilaterals, or more
/// than one across the wall
Strip make_strip(const Mesh<2>& mesh);

/// Supports of the fibres: a [[solid.fix]] of any node of a fibre holds its middle ("x", "y") and its
/// "rotation"; no components: all three.
/// @throws InputError for unknown names and components
std::vector<std::array<bool, 3>> fibre_supports(const Mesh<2>& mesh, const Strip& strip,
                                                const SolidConfig& config);

/// Strip of quadrilaterals `thickness` thick about a line of two-node elements: a chain or a closed one.
/// Surfaces: "left" and "right" of the way along the line, "start" and "end" (open chains); node sets of the
/// line become those of both faces.
/// @throws InputError if the line branches or has no elements
Mesh<2> strip_about(const Mesh<2>& line, double thickness);

/// Line through the points (x, y, x, y, …), each stretch divided into elements of about `element_size` [m].
Mesh<2> polyline(const std::vector<double>& points, double element_size);

} // namespace undine::solid
