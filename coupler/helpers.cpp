// What the coupler's helpers are asked for.
#include "coupler/helpers.hpp"

#include "common/error.hpp"
#include "coupler/gradients.hpp"
#include "coupler/mortar.hpp"

#include <optional>

namespace undine::coupler
{

void help(const link::Team& team)
{
  std::optional<Gradients> gradients;
  for (;;)
  {
    const auto bytes = team.tell({});
    if (bytes.empty())
    {
      team.collect({});
      return;
    }
    link::wire::Reader in(bytes, "task of a helper");
    switch (static_cast<Task>(in.i32("task")))
    {
    case Task::integrals_2d:
      help_to_integrate<2>(team, in);
      break;
    case Task::integrals_3d:
      help_to_integrate<3>(team, in);
      break;
    case Task::rows:
      gradients.emplace(Gradients::receive(team));
      break;
    case Task::solution:
      require(gradients.has_value(), "an operator comes before its solutions");
      gradients->help(in);
      break;
    }
  }
}

void dismiss_helpers(const link::Team& team)
{
  if (team.size() == 1)
    return;
  team.tell({});
  team.collect({}); // a helper that is stopped would let MPI_Finalize wait for ever
}

} // namespace undine::coupler
