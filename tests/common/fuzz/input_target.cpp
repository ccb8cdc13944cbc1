// Fuzzing of what users give: the case file (UNDINE_FUZZ_CASE) and the mesh readers (UNDINE_FUZZ_GMSH,
// UNDINE_FUZZ_ABAQUS).
#include "common/config/coupling_config.hpp"
#include "common/config/run_config.hpp"
#include "common/error.hpp"
#include "common/mesh/mesh.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>

namespace
{

using namespace undine;

#ifdef UNDINE_FUZZ_CASE

/// All tables that the three programs share.
void feed(const std::string& text)
{
  const CaseFile file = CaseFile::parse(text, "case.toml");
  const RunConfig run = read_run_config(file);
  read_coupling(file);
  read_output_config(file, "out");
  read_checkpoint_config(file);
  read_probe_configs(file, run.dim);
  file.reject_unknown_keys({"run", "output", "probe", "coupling", "interface", "checkpoint"});
}

#else

/// A file without a disk.
std::string in_memory(const std::string& text)
{
  static const int file = memfd_create("mesh", 0);
  if (file < 0 || ftruncate(file, 0) != 0 ||
      pwrite(file, text.data(), text.size(), 0) != static_cast<ssize_t>(text.size()))
    std::abort();
  return "/proc/self/fd/" + std::to_string(file);
}

template <int dim>
void read(const std::string& path)
{
#ifdef UNDINE_FUZZ_GMSH
  const Mesh<dim> mesh = read_gmsh<dim>(path);
#else
  const Mesh<dim> mesh = read_abaqus<dim>(path);
#endif
  for (const auto& block : mesh.blocks)
    for (const index_t n : block.nodes)
      if (n < 0 || n >= mesh.n_nodes())
        std::abort(); // accepted, but it would crash later
}

void feed(const std::string& text)
{
  const std::string path = in_memory(text);
  try
  {
    read<2>(path);
  }
  catch (const Failure&)
  {
  }
  read<3>(path);
}

#endif

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
  try
  {
    feed(std::string(reinterpret_cast<const char*>(data), size));
  }
  catch (const InternalError&)
  {
    std::abort(); // a bug of ours, not a mistake of the user
  }
  catch (const Failure&)
  {
  }
  return 0; // any other exception ends the program
}
