// Ranks from an MPI communicator.
#pragma once

#include "common/parallel/ranks.hpp"

#include <mpi.h>

namespace undine
{

/// The ranks of `comm`, which stays the caller's. A communicator of one rank gives Ranks without MPI.
/// @param deadline a rank may keep another waiting for that long [s]; 0: for ever
Ranks ranks_of(MPI_Comm comm, double deadline);

} // namespace undine
