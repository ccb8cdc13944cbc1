// What the solid writes: frames, histories of probes, the energy ledger, the summary part.
#pragma once

#include "common/config/run_config.hpp"
#include "common/io/frames.hpp"
#include "common/io/history.hpp"
#include "solid_fe/solid.hpp"

#include <optional>
#include <string>
#include <vector>

namespace undine::solid
{

/// Stress of each element, block after block: mean over its points. Size n_elements.
struct CellStress
{
  std::vector<double> sigma;          ///< Cauchy stress, 9 numbers per element, row by row [Pa]
  std::vector<double> von_mises;      ///< of the mean stress [Pa]
  std::vector<double> plastic_strain; ///< equivalent, mean over the points; 0 for elastic laws
};

/// Collective.
template <int dim>
CellStress cell_stress(const Solid<dim>& solid);

/// Number of the node nearest to `point` in the reference state.
template <int dim>
index_t nearest_node(const Solid<dim>& solid, const Vec<dim>& point);

/// What a probe of the solid measures: "u" [m], "v" [m/s], "a" [m/s²] at the material point nearest to
/// `point`, or their mean over `surface`; "F", the force of the supports on `surface` (or on that one node)
/// [N]; "S", force and moment [N m] through the cut across `normal` at `point`; "p", "von_mises" [Pa] and
/// "plastic_strain": mean stress with the sign of a pressure, equivalent stress and strain of the element
/// nearest to `point`. Forces are per metre of thickness in 2-D.
std::vector<std::string> probe_quantities();

/// Check the probes of the solid without writing. @throws InputError for a surface or quantity that is not
/// there
template <int dim>
void check_probes(const std::vector<ProbeConfig>& probes, const Solid<dim>& solid);

/// Files of one run in its output folder: solid.h5/.xdmf, history/<probe>.csv, history/solid_energy.csv. On
/// several ranks rank 0 writes, and all functions are collective.
/// @throws InputError for a probe that cannot be (surface, quantity), Failure(output_failed) from its writers
template <int dim>
class SolidOutput
{
public:
  SolidOutput(const OutputConfig& config, const std::vector<ProbeConfig>& probes, const Solid<dim>& solid);

  void write_frame(const Solid<dim>& solid); ///< displacement, velocity, stress on the current mesh
  /// One row in every history; `e` are the energies of `solid` now.
  void write_history(const Solid<dim>& solid, const Energies& e);
  void for_each_state(StateArchive& archive);

private:
  struct Probe
  {
    std::vector<index_t> nodes;
    std::vector<double> weight; ///< of the mean over the nodes; sums to 1
    std::vector<std::string> quantities;
    History history;
    Vec<dim> point{}, normal{};
    std::size_t element = 0; ///< nearest to the point, in the order of cell_stress
  };

  std::optional<FrameWriter> frames_;
  std::vector<Probe> probes_;
  History energy_;
  bool writes_ = true; ///< on rank 0
};

} // namespace undine::solid
