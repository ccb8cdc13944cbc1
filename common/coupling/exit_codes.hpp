// Exit codes that the protocol library itself uses; the same numbers as common/error.hpp.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace undine::link::code
{

inline constexpr int internal_error = 1;        ///< the library was called in a way it does not allow
inline constexpr int bad_case = 2;              ///< the solver cannot do what the run asks
inline constexpr int bad_input_file = 4;        ///< the coupler rejected the wet surface
inline constexpr int mpi_start_incomplete = 31; ///< a program on the line never called MPI_Init
inline constexpr int no_hello = 32;             ///< a rank never spoke
inline constexpr int wrong_protocol = 33;       ///< another major version, or another byte order
inline constexpr int different_case = 34;       ///< the programs read different cases
inline constexpr int missing_role = 35;         ///< a role is missing, doubled or unknown to the coupler
inline constexpr int partner_silent = 36;       ///< nothing came within the stall limit
inline constexpr int message_out_of_order = 37; ///< a message is corrupt or not allowed now
inline constexpr int partner_failed = 40;       ///< the partner said FAIL

} // namespace undine::link::code
