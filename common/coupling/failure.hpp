// The way out of a process that ends in an error: who speaks, what is written, how the others are ended.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <string>

namespace undine::link
{

/// True once a FAIL has left this process: then the coupler reports it, and abort_world() leaves it the time
/// to do so.
inline std::atomic<bool> failure_announced{false};

/// Seconds that the process at a place in the queue leaves to those before it, when several see the same
/// error: the first has 0, the others follow one after the other.
double courtesy_of(int position);

/// What abort_world() waits before it speaks [s]; negative: not known yet.
inline std::atomic<double> courtesy{-1.0};

/// Print `text`, write FAILED.toml into `out_dir` (if not empty, and unless another program of this run
/// already has), then MPI_Abort(MPI_COMM_WORLD, code); before MPI_Init and after MPI_Finalize _Exit(code). A
/// step and a time are taken from the text where it says "step 12" and "t = 0.5".
///
/// When several programs see the same error only one shall speak: world rank 0 in the hand-shake, the coupler
/// in the run. The others wait 0.3 s and more, five seconds if they announced the failure with a FAIL
/// message, and are normally killed meanwhile.
[[noreturn]] void abort_world(int code, const std::string& role, const std::string& text,
                              const std::string& out_dir);

/// The same without the end: print `text` and write FAILED.toml, for a program that runs alone and returns
/// its code.
void report_failure(int code, const std::string& role, const std::string& text, const std::string& out_dir);

} // namespace undine::link
