// The command line that the three programs share.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace undine
{

struct CommandLine
{
  std::string case_path;              ///< the case.toml
  std::string out_dir;                ///< output folder
  std::vector<std::string> overrides; ///< "table.key=value", for CaseFile::read; --until T is "run.t_end=T"
  std::string restart;     ///< --restart: "latest", a checkpoint's name or folder; empty: from the start
  bool check_only = false; ///< --check: read and validate, do not run
  double progress = 0.0;   ///< --progress: time between progress lines [s]; 0: 1 on a terminal, else 30
  bool verbose = false;
  bool document_keys = false; ///< --document-keys: print CaseFile::documentation and end
  int modes = 0;              ///< --modes N (solid only): print N natural frequencies and end; 0: run
  std::string name;           ///< --name (solid only): which [[solid]] of the case; empty: the only one
  std::string answer;         ///< --help or --version: print this and end with exit code 0; else empty
};

/// Read `role case.toml [--out DIR] [--set table.key=value]... [--until T] [--restart latest|ID] [--check]
/// [--verbose]
/// [--progress S]
/// [--name SOLID] [--modes N] [--document-keys] [--version] [--help]`. A folder in place of the file means
/// its case.toml; the default of
/// --out is runs/<name of the case's folder>.
/// @throws InputError (exit code 2) that names the argument
CommandLine parse_command_line(std::string_view role, int argc, const char* const* argv);

} // namespace undine
