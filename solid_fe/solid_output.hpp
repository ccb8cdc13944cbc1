// What the solid writes: frames, histories of probes, the energy ledger, the summary part.
#pragma once

#include "common/io/frames.hpp"
#include "common/io/history.hpp"
#include "common/io/summary.hpp"
#include "solid_fe/solid.hpp"

#include <memory>
#include <string>
#include <vector>

namespace undine::solid
{

/// A material point whose motion is recorded: the node nearest to `point` in the reference state.
struct ProbeConfig
{
  std::string name;
  std::vector<double> point; ///< [m], dim numbers
  std::string definition;    ///< for the reader of the file; "" for a default
};

/// Stress of each element, block after block: mean over its points. Size n_elements.
struct CellStress
{
  std::vector<double> sigma;     ///< Cauchy stress, 9 numbers per element, row by row [Pa]
  std::vector<double> von_mises; ///< of the mean stress [Pa]
};

template <int dim>
CellStress cell_stress(const Solid<dim>& solid);

/// Number of the node nearest to `point` in the reference state.
template <int dim>
index_t nearest_node(const Solid<dim>& solid, const Vec<dim>& point);

/// Files of one run in `out_dir`: solid.h5/.xdmf, history/<probe>.csv, history/solid_energy.csv.
/// @throws Failure(output_failed) from its writers
template <int dim>
class SolidOutput
{
public:
  SolidOutput(const std::string& out_dir, const std::vector<ProbeConfig>& probes, const Solid<dim>& solid);

  void write_frame(const Solid<dim>& solid);   ///< displacement, velocity, stress on the current mesh
  void write_history(const Solid<dim>& solid); ///< one row in every history

private:
  struct Probe
  {
    std::size_t node;
    History history;
  };
  FrameWriter frames_;
  std::vector<Probe> probes_;
  History energy_;
};

} // namespace undine::solid
