// Reads the tables [run], [output] and [[probe]].
#include "common/config/run_config.hpp"

#include <algorithm>
#include <filesystem>
#include <optional>

namespace undine
{

RunConfig read_run_config(const CaseFile& file)
{
  const CaseTable run = file.table("run", "What is run, for how long, and how finely.");
  RunConfig config;
  // The folder of a case names it, so that a file need not repeat it.
  const std::string folder =
      (std::filesystem::current_path() / file.path()).parent_path().filename().string();
  config.name =
      run.optional_text({"name", "", "name of the case; that of its folder if absent"}).value_or(folder);
  config.dim = static_cast<int>(run.integer({"dimension", "", "2 (plane strain) or 3"}, 2, between(2, 3)));
  config.t_end = run.number({"t_end", "s", "the run goes from t = 0 to this time"}, positive());
  config.resolution = run.number(
      {"resolution", "", "elements over the characteristic length; refines all parts together"}, positive());
  config.characteristic_length = run.number(
      {"characteristic_length", "m", "length that the resolution counts elements over"}, positive());
  config.preset =
      run.choice({"preset", "", "defaults of the fluid for free-surface flow or for violent impact"},
                 "hydraulic", {"hydraulic", "impact"});
  config.rank_timeout = run.number(
      {"rank_timeout", "s",
       "a rank of a program that runs alone may keep the others waiting for that long; 0: for ever"},
      300.0, non_negative());
  return config;
}

OutputConfig read_output_config(const CaseFile& file, const std::string& out_dir)
{
  const CaseTable output = file.table("output", "What is written, and how often.");
  OutputConfig config;
  config.dir = out_dir;
  config.frame_interval = output.number(
      {"every", "s", "time between field frames; 0 writes the first and the last only"}, 0.0, non_negative());
  const std::optional<double> history =
      output.optional_number({"history_every", "s",
                              "time between rows of histories; 0 writes every window or step. Default: a "
                              "thousandth of the run for a fluid alone, else 0"},
                             non_negative());
  config.history_interval = history.value_or(0.0);
  config.history_asked = history.has_value();
  config.frames = output.boolean({"frames", "", "write field frames"}, true);
  return config;
}

CheckpointConfig read_checkpoint_config(const CaseFile& file)
{
  const CaseTable t =
      file.table("checkpoint", "When the whole state is written, to continue from it with --restart.");
  CheckpointConfig config;
  config.every = t.number({"every", "s", "simulated time between checkpoints; 0: none"}, 0.0, non_negative());
  config.every_wall =
      t.number({"every_wall", "s", "wall time between checkpoints; 0: none"}, 0.0, non_negative());
  config.wall_limit =
      t.number({"wall_limit", "s",
                "wall time after which the run writes a checkpoint and ends with code 3; 0: no limit"},
               0.0, non_negative());
  config.keep = t.integer({"keep", "", "checkpoints that stay; 0: all"}, 2, at_least(0));
  return config;
}

std::vector<ProbeConfig> read_probe_configs(const CaseFile& file, int dim)
{
  std::vector<ProbeConfig> probes;
  std::vector<std::string> parts{"fluid", "interface"};
  for (const std::string& solid : file.names_of("solid"))
    parts.insert(parts.end() - 1, solid);
  for (const CaseTable& table : file.tables("probe", "A history at a point or over a named surface."))
  {
    ProbeConfig probe;
    probe.name = table.text({"name", "", "name of the file history/<name>.csv"});
    probe.on = table.choice(
        {"on", "",
         "side that is measured, one of several solids by its name; interface: pressure of the link on the "
         "solid's surface"},
        parts);
    probe.surface = table.text({"surface", "", "named surface over which the mean is taken"}, "");
    probe.relative_to =
        table.numbers({"relative_to", "m",
                       "solid: material point whose u, v and a are subtracted, such as a clamp that moves"},
                      table.has("relative_to") ? static_cast<std::size_t>(dim) : 0, {}, any_number());
    probe.point = table.numbers(
        {"point", "m", "point that is followed: a material point of the solid, a place of the fluid"},
        table.has("point") ? static_cast<std::size_t>(dim) : 0, {}, any_number());
    probe.normal = table.numbers({"normal", "",
                                  "solid, quantity S: direction across the cut through the point; S is the "
                                  "force (and moment about the point) "
                                  "that the part it points to feels from the part behind"},
                                 table.has("normal") ? static_cast<std::size_t>(dim) : 0, {}, any_number());
    probe.radius = table.number(
        {"radius", "m",
         "fluid: mean over the nodes within this distance of the fixed point; 0: follow one node; "
         "interface: size of the patch"},
        0.0, non_negative());
    probe.wall = table.text({"wall", "", "fluid: name of the wall whose force is measured"}, "");
    const Key quantity{"quantity", "", "what is measured, such as \"u\" or [\"p\", \"v\"]"};
    if (table.is_text(quantity.name))
      probe.fields = {table.text(quantity)};
    else
      probe.fields = table.texts(quantity, {});

    if (probe.name.empty() || probe.name.find('/') != std::string::npos)
      table.fail("name", "must be a file name without '/'");
    if (std::any_of(probes.begin(), probes.end(),
                    [&](const ProbeConfig& other) { return other.name == probe.name; }))
      table.fail("name", "another probe has this name");
    const bool whole =
        probe.fields.size() == 1 && (probe.fields[0] == "front" || probe.fields[0] == "hydrostatic_error");
    const int places = (!probe.point.empty()) + (!probe.surface.empty()) + (!probe.wall.empty());
    if (!whole && places != 1)
      table.fail("", places == 0 ? "a probe needs a 'point', a 'surface' or (fluid) a 'wall'"
                                 : "a probe has one of 'point', 'surface' and 'wall', not several");
    if (probe.fields.empty())
      table.fail("quantity", "a probe needs a 'quantity', such as \"u\" or [\"p\", \"v\"]");
    probes.push_back(std::move(probe));
  }
  return probes;
}

} // namespace undine
