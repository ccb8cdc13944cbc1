// The command line that the three programs share, read with CLI11.
#include "common/config/command_line.hpp"

#include "common/error.hpp"

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <optional>

namespace undine
{

namespace
{

std::string default_out_dir(const std::string& case_path)
{
  const auto folder =
      std::filesystem::absolute(case_path).lexically_normal().parent_path().filename().string();
  return "runs/" + (folder.empty() ? "case" : folder);
}

} // namespace

CommandLine parse_command_line(std::string_view role, int argc, const char* const* argv)
{
  CommandLine line;
  const std::string program =
      argc > 0 ? std::filesystem::path(argv[0]).filename().string() : std::string(role);
  std::optional<double> until;
  bool version = false;
  CLI::App app("Undine: explicit fluid-structure interaction. Programs: coupler, fluid_pfem, solid_fe.",
               program);
  app.add_option("case", line.case_path, "case.toml, or the folder that holds it");
  app.add_option("--out", line.out_dir, "output folder (default: runs/<case folder>)");
  app.add_option("--set", line.overrides, "table.key=value: replace a value of the case; repeatable")
      ->allow_extra_args(false);
  app.add_option("--until", until, "end at this time [s] instead of run.t_end");
  app.add_option("--restart", line.restart,
                 "continue from the newest checkpoint (latest), or from one by name or folder");
  app.add_option("--progress", line.progress,
                 "seconds between progress lines (default: 1 on a terminal, else 30)")
      ->check(CLI::PositiveNumber);
  app.add_flag("--check", line.check_only, "read and check everything, do not run");
  app.add_flag("--verbose", line.verbose, "log more");
  app.add_flag("--document-keys", line.document_keys, "print the keys of the case file as Markdown");
  if (role == "solid")
    app.add_option("--name", line.name, "which [[solid]] of the case; not needed where there is only one");
  if (role == "solid")
    app.add_option("--modes", line.modes, "print this many natural frequencies of the solid and end")
        ->check(CLI::PositiveNumber);
  app.add_flag("--version", version, "print the version");
  app.footer("Keys of the case: docs/case-file.md. Exit codes: 0 reached the end, 2 mistake in case or "
             "command line, 3 stopped on "
             "request,\n4 file cannot be read, 10 numerical failure, 11 output failed, 31 to 37 the programs "
             "do not go "
             "together, 40 a partner\nfailed; README.md has all. Without a coupler on the mpirun line a "
             "program runs its part alone.\n"
             "Example: mpirun -n 1 coupler case.toml : -n 1 fluid_pfem case.toml : -n 1 solid_fe case.toml");
  try
  {
    app.parse(argc, argv);
  }
  catch (const CLI::CallForHelp&)
  {
    line.answer = app.help();
    return line;
  }
  catch (const CLI::ParseError& error)
  {
    throw InputError(fmt::format("command line: {} (see {} --help)", error.what(), program));
  }
  if (version)
  {
    line.answer = fmt::format("{} {}\n", program, UNDINE_VERSION);
    return line;
  }
  if (line.case_path.empty() && !line.document_keys)
    throw InputError(
        fmt::format("command line: the case is missing: {} case.toml (see {} --help)", program, program));
  if (std::filesystem::is_directory(line.case_path))
    line.case_path = (std::filesystem::path(line.case_path) / "case.toml").string();
  if (line.out_dir.empty() && !line.case_path.empty())
    line.out_dir = default_out_dir(line.case_path);
  if (until)
  {
    if (!std::isfinite(*until) || *until <= 0.0)
      throw InputError(fmt::format("command line: --until {}: must be positive (end time, s)", *until));
    line.overrides.push_back(fmt::format("run.t_end={}", *until));
  }
  return line;
}

} // namespace undine
