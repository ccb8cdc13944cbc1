// The scripts of undine-conform: what the fake coupler says, and what the solver must do.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace undine::link::conform
{

struct Options
{
  std::string role = "solid";
  std::vector<std::string> interfaces{"wet"};
  int dim = 2;
  int ranks = 1;       ///< of the program under test
  double limit = 20.0; ///< one run [s]
  double stall = 0.0;  ///< stall limit of the program under test [s]; 0: unknown
  std::string only;
  bool verbose = false;
  std::string folder;               ///< where runs leave their findings
  bool force_in = false;            ///< the program is at level A, as its HELLO says
  std::vector<std::string> program; ///< command of the program under test
};

/// One run of the program under test.
struct Script
{
  std::string name;
  std::string purpose;
  int expected_code = 0;   ///< exit code of the program; -1: any but 0
  std::string code_clause; ///< clause of docs/protocol.md that says so
};

/// In the order in which they are played; later ones compare with what earlier ones have recorded.
const std::vector<Script>& scripts();

/// Exit code of the player when the program under test did not react to a wrong message in time.
inline constexpr int not_noticed = 99;

/// Left in the folder by a script that means nothing at the program's level; its end is not judged.
inline constexpr const char* not_applicable = "not_applicable";

/// Plays one script as world rank 0; findings go to `folder`/findings, one per line: "pass|FAIL|note <tab>
/// clause <tab> text".
int play(const std::string& script, const Options&, int argc, char** argv);

} // namespace undine::link::conform
