// Participants and coupler in one process: threads on memory channels, the same loops and messages as the
// programs.
#pragma once

#include "coupler/run.hpp"
#include "fluid_pfem/run.hpp"
#include "solid_fe/run.hpp"

#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace undine::test
{

/// A program of the line: its role, and what it does with its link.
struct Participant
{
  std::string role;
  std::function<void(link::SolverLink&)> serve;
  std::function<std::unique_ptr<link::Channel>(std::unique_ptr<link::Channel>)> wrap =
      nullptr; ///< of its end of the channel
};

template <int dim>
Participant participant(const std::string& role, solid::Solid<dim>& solid)
{
  return {.role = role,
          .serve = [&solid](link::SolverLink& link) { solid::run_coupled<dim>(solid, link, {}, nullptr); }};
}

template <int dim>
Participant participant(const std::string& role, fluid::Fluid<dim>& fluid)
{
  return {.role = role, .serve = [&fluid](link::SolverLink& link) {
            fluid::run_coupled<dim>(fluid, link, 0.0, [](double, const fluid::Fluid<dim>&, bool) {});
          }};
}

/// Run the coupler and all participants, that of the fluid's side first, until t_end. `after_window` is
/// called by the coupler while the participants wait, so it may look at them. The coupler's exception is
/// thrown again here, or else the first of a participant.
inline void run_in_memory(const std::vector<Participant>& participants, const coupler::CouplerConfig& config,
                          const std::function<void(const coupler::WindowRecord&)>& after_window)
{
  std::vector<std::thread> threads;
  std::vector<std::exception_ptr> errors(participants.size() + 1); // the coupler's first
  {
    std::vector<link::PartnerLink> partners;
    for (std::size_t k = 0; k < participants.size(); ++k)
    {
      auto [to_participant, to_coupler] = link::memory_channel(60.0);
      partners.emplace_back(std::move(to_participant), participants[k].role);
      threads.emplace_back(
          [&, k, channel = std::move(to_coupler)]() mutable
          {
            try
            {
              if (participants[k].wrap)
                channel = participants[k].wrap(std::move(channel));
              link::SolverLink link(std::move(channel));
              participants[k].serve(link);
            }
            catch (...)
            {
              errors[k + 1] = std::current_exception();
            }
          });
    }
    std::vector<link::PartnerLink*> of_solids;
    for (std::size_t k = 1; k < partners.size(); ++k)
      of_solids.push_back(&partners[k]);
    try
    {
      coupler::Group fluid({&partners[0]}), solids(of_solids);
      coupler::run(config, fluid, solids, after_window);
    }
    catch (...)
    {
      errors[0] = std::current_exception();
    }
  }
  for (std::thread& thread : threads)
    thread.join();
  for (const auto& error : errors)
    if (error)
      std::rethrow_exception(error);
}

/// One fluid, or what takes its side, and one solid.
template <class First, class Second>
void run_in_memory(First& fluid, Second& solid, const coupler::CouplerConfig& config,
                   const std::function<void(const coupler::WindowRecord&)>& after_window)
{
  run_in_memory({participant("fluid", fluid), participant("solid", solid)}, config, after_window);
}

} // namespace undine::test
