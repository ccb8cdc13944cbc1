// Fluid, solid and coupler in one process: three threads on memory channels, the same loops and messages as
// the programs.
#pragma once

#include "coupler/run.hpp"
#include "coupler/run_contact.hpp"
#include "fluid_pfem/run.hpp"
#include "solid_fe/run.hpp"

#include <exception>
#include <functional>
#include <thread>

namespace undine::test
{

/// Run all three until t_end. `after_window` is called by the coupler while both solvers wait, so it may look
/// at them. The first exception of any thread is thrown again here.
template <int dim>
void run_in_memory(fluid::Fluid<dim>& fluid, solid::Solid<dim>& solid, const coupler::CouplerConfig& config,
                   const std::function<void(const coupler::WindowRecord&)>& after_window)
{
  auto [coupler_to_fluid, fluid_to_coupler] = link::memory_channel(60.0);
  auto [coupler_to_solid, solid_to_coupler] = link::memory_channel(60.0);
  std::exception_ptr of_fluid, of_solid, of_coupler;

  std::thread fluid_thread(
      [&, channel = std::move(fluid_to_coupler)]() mutable
      {
        try
        {
          link::SolverLink link(std::move(channel));
          fluid::run_coupled<dim>(fluid, link, [](double, const fluid::Fluid<dim>&, bool) {});
        }
        catch (...)
        {
          of_fluid = std::current_exception();
        }
      });
  std::thread solid_thread(
      [&, channel = std::move(solid_to_coupler)]() mutable
      {
        try
        {
          link::SolverLink link(std::move(channel));
          solid::run_coupled<dim>(solid, link, {}, nullptr);
        }
        catch (...)
        {
          of_solid = std::current_exception();
        }
      });
  try
  {
    link::PartnerLink fluid_partner(std::move(coupler_to_fluid), "fluid"),
        solid_partner(std::move(coupler_to_solid), "solid");
    (config.coupling.has_contact() ? coupler::run_contact : coupler::run_coupler)(
        config, fluid_partner, solid_partner, after_window, {}, {});
  }
  catch (...)
  {
    of_coupler = std::current_exception();
  }
  fluid_thread.join();
  solid_thread.join();
  // A solver's own failure explains more than the silence it leaves behind.
  for (const auto& error : {of_fluid, of_solid, of_coupler})
    if (error && error != of_coupler && !of_coupler)
      std::rethrow_exception(error);
  if (of_coupler)
    std::rethrow_exception(of_coupler);
}

} // namespace undine::test
