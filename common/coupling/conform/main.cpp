// undine-conform: plays the coupler to one solver and says which rules of docs/protocol.md it keeps.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conform/launch.hpp"
#include "common/coupling/conform/scripts.hpp"

#include <cstdio>
#include <cstdlib>
#include <string>

namespace
{

using namespace undine::link::conform;

constexpr const char* help =
    R"(undine-conform [options] -- PROGRAM [ARGUMENT...]

Starts PROGRAM with mpirun, once per script, plays the coupler to it, and prints pass or FAIL per rule of
docs/protocol.md. Exit code: 0 all rules kept, 1 not all, 2 wrong use.

  --role NAME        part that the program plays (solid)
  --interface NAME   interface of the set-up (wet); repeat for several
  --dim N            2 or 3 (2)
  --ranks N          ranks of the program (1); their rows are exchanged with them where MESH says so
  --limit S          seconds a run may take (20)
  --stall S          stall limit that the program was started with; without it the silent coupler is not played
  --only TEXT        only scripts whose name contains TEXT
  --list             names of the scripts
  --verbose          show what the programs print

example: undine-conform --interface wet -- python3 my_solid.py case.toml
)";

[[noreturn]] void refuse(const std::string& text)
{
  std::fprintf(stderr, "error: undine-conform: %s; see undine-conform --help\n", text.c_str());
  std::exit(2);
}

} // namespace

int main(int argc, char** argv)
{
  Options options;
  std::string script;
  bool interfaces_given = false;
  for (int i = 1; i < argc; ++i)
  {
    const std::string word = argv[i];
    const auto value = [&]() -> std::string
    {
      if (i + 1 >= argc)
        refuse(word + " needs a value");
      return argv[++i];
    };
    if (word == "--")
    {
      options.program.assign(argv + i + 1, argv + argc);
      break;
    }
    if (word == "--help" || word == "-h")
    {
      std::fputs(help, stdout);
      return 0;
    }
    if (word == "--list")
    {
      for (const Script& s : scripts())
        std::printf("%-28s %s\n", s.name.c_str(), s.purpose.c_str());
      return 0;
    }
    if (word == "--role")
      options.role = value();
    else if (word == "--interface")
    {
      if (!interfaces_given)
        options.interfaces.clear();
      interfaces_given = true;
      options.interfaces.push_back(value());
    }
    else if (word == "--dim")
      options.dim = std::atoi(value().c_str());
    else if (word == "--ranks")
      options.ranks = std::atoi(value().c_str());
    else if (word == "--limit")
      options.limit = std::atof(value().c_str());
    else if (word == "--stall")
      options.stall = std::atof(value().c_str());
    else if (word == "--only")
      options.only = value();
    else if (word == "--verbose")
      options.verbose = true;
    else if (word == "--play") // internal: this process is world rank 0 of one script
      script = value();
    else if (word == "--folder")
      options.folder = value();
    else
      refuse("unknown option '" + word + "'");
  }
  if (options.dim != 2 && options.dim != 3)
    refuse("--dim is 2 or 3");
  if (options.ranks < 1)
    refuse("--ranks is 1 or more");
  if (!script.empty())
    return play(script, options, argc, argv);
  if (options.program.empty())
    refuse("no program: undine-conform [options] -- PROGRAM [ARGUMENT...]");
  return run_all(options, argv[0]);
}
