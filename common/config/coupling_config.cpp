// Reader of [coupling] and [[interface]].
#include "common/config/coupling_config.hpp"

#include "common/error.hpp"

namespace undine
{

namespace
{

InterfaceConfig read_interface(const CaseTable& t, const std::vector<std::string>& solids)
{
  InterfaceConfig i;
  i.name = t.text({"name", "", "name of the interface in messages and histories"});
  i.fluid =
      t.text({"fluid", "", "name of the fluid's surface; \"boundary\" with separation = true: all of it"});
  const Key solid{"solid", "", "name of the solid's surface, or a list of them"};
  i.solid_surfaces = t.is_text("solid") || !t.has("solid") ? std::vector{t.text(solid)} : t.texts(solid, {});
  for (const auto& surface : i.solid_surfaces)
    i.solid += (i.solid.empty() ? "" : ", ") + surface;
  const Key body{"body", "",
                 "name of the [[solid]] that the surface belongs to; needed where there are several"};
  i.body = solids.size() == 1 ? t.choice(body, solids[0], solids) : t.choice(body, solids);
  i.kind = t.choice({"kind", "",
                     "slip: only the normal velocity is continuous; no_slip: all of it, with separation = "
                     "true where the fluid presses on the solid"},
                    "slip", {"slip", "no_slip"});
  i.separation =
      t.boolean({"separation", "", "the fluid may leave the solid where the interface pulls"}, false);
  if (i.separation != (i.fluid == InterfaceConfig::whole_boundary))
    t.fail(
        i.separation ? "fluid" : "separation",
        "with separation = true any part of the fluid may meet the solid: write fluid = \"boundary\"; with "
        "separation = false name the surface of the fluid that stays on it");
  i.multiplier = t.choice({"multiplier", "", "the side that carries the Lagrange multipliers"}, "finer",
                          {"finer", "fluid", "solid"});
  return i;
}

/// What is solved, in which form of the window and by what, and what of it goes with what.
void read_method(const CaseTable& t, CouplingConfig& config)
{
  config.scheme =
      t.choice({"scheme", "",
                "gc: Gravouil-Combescure, each side with its own step; staggered: for a foreign solid "
                "that takes forces only"},
               "gc", {"gc", "staggered"});
  if (config.scheme == "staggered" && config.has_contact())
    t.fail("scheme", "separation = true needs a solid that gives free velocities; write scheme = \"gc\"");
  config.form = t.choice(
      {"form", "",
       "of the window where the surfaces stay together; gravouil_combescure: they meet in every fine step; "
       "macro_continuity: at the window's end only, which loses no energy and runs the fine side several "
       "times; half_step: in the middle of equal steps, as contact does"},
      "gravouil_combescure", {"gravouil_combescure", "macro_continuity", "half_step"});
  if (config.form != "gravouil_combescure" && (config.scheme == "staggered" || config.has_contact()))
    t.fail("form", config.has_contact()
                       ? "separation = true has a form of its own, that of half steps; leave form out"
                       : "a solid that takes forces only knows no other form; leave form out");
  config.lumped =
      t.choice({"operator", "",
                "exact: velocities meet; lumped: row sums of the interface operator, without a factor, "
                "for comparison; refused where it is not stable"},
               "exact", {"exact", "lumped"}) == "lumped";
  if (config.lumped && (config.scheme == "staggered" || config.has_contact()))
    t.fail("operator",
           "only the coupling of surfaces that stay together (scheme = \"gc\", separation = false) can "
           "be lumped; write operator = \"exact\"");
  if (config.lumped && config.form == "macro_continuity")
    t.fail("operator", "form = \"macro_continuity\" finds multipliers by trial, whatever the operator; write "
                       "operator = \"exact\"");
  config.solver = t.choice({"solver", "",
                            "of the multipliers where the surfaces stay together; factor: LDLT, by rank 0 of "
                            "the coupler; gradients: conjugate "
                            "gradients to a residual of 1e-12, shared by its ranks; auto: gradients in space "
                            "from 10000 multipliers on"},
                           "auto", {"auto", "factor", "gradients"});
  if (config.solver != "auto" && (config.has_contact() || config.lumped))
    t.fail("solver", config.has_contact() ? "separation = true has a solver of its own; leave solver out"
                                          : "operator = \"lumped\" solves nothing; leave solver out");
  for (const InterfaceConfig& i : config.interfaces)
    if (i.separation != config.has_contact())
      t.fail("", "interface '" + i.name +
                     "': all interfaces of a case either let the fluid leave or keep it; write the same "
                     "separation in "
                     "each [[interface]]");
}

} // namespace

CouplingConfig read_coupling(const CaseFile& file)
{
  CouplingConfig config;
  config.present = file.has_table("coupling") || file.has_table("interface");
  config.solids = file.names_of("solid");
  for (const std::string& name : config.solids)
    if (name == "fluid" || name == "coupler")
      throw InputError("solid.name = \"" + name + "\": another program has this role; choose another name");
  for (const CaseTable& t :
       file.tables("interface", "A pair of surfaces through which fluid and solid act on each other."))
    config.interfaces.push_back(read_interface(t, config.solids));
  const CaseTable t = file.table("coupling", "How the coupler runs.");
  read_method(t, config);
  config.fine =
      t.choice({"fine", "", "the side with the smaller steps; auto: whichever has the smaller stable step"},
               "auto", {"auto", "fluid", "solid"});
  if (!t.is_text("substeps"))
    config.substeps = t.optional_integer(
        {"substeps", "", "fine steps per window; \"auto\": as many as the stable steps ask for"},
        at_least(1));
  else
    t.choice({"substeps", "", "fine steps per window; \"auto\": as many as the stable steps ask for"}, "auto",
             {"auto"});
  if (config.form == "half_step" && config.substeps.value_or(1) != 1)
    t.fail("substeps",
           "form = \"half_step\" is stable at equal steps only; write substeps = 1 or leave it out");
  config.substeps_max = t.integer({"substeps_max", "", "most fine steps per window"}, 300, at_least(1));
  config.dt_max = t.number({"dt_max", "s", "longest window; 0: no limit"}, 0.0, non_negative());
  config.search_distance = t.number(
      {"search_distance", "m", "surfaces further apart do not meet; 0: half a face"}, 0.0, non_negative());
  config.energy_limit =
      t.number({"energy_limit", "",
                "largest interface energy that nothing explains, over the work done, before the run stops"},
               0.05, positive());
  config.hello_timeout =
      t.number({"hello_timeout", "s", "every program must have spoken by then"}, 60.0, positive());
  config.stall_timeout = t.number(
      {"stall_timeout", "s", "a program may be silent for that long; 0: for ever"}, 300.0, non_negative());
  if (config.present && config.interfaces.empty())
    t.fail("", "a coupled case needs at least one [[interface]] with name, fluid and solid");
  for (const std::string& solid : config.solids)
    if (config.present && std::none_of(config.interfaces.begin(), config.interfaces.end(),
                                       [&solid](const auto& i) { return i.body == solid; }))
      t.fail("", "the solid '" + solid + "' has no [[interface]]: write one with body = \"" + solid + "\"");
  return config;
}

} // namespace undine
