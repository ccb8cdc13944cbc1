// The kinds of failure and their exit codes; `main` is the only place that catches them.
#pragma once

#include <source_location>
#include <stdexcept>
#include <string>

namespace undine
{

/// Exit codes of all programs; below 126, so that a shell can tell them from signals.
enum class ExitCode : int
{
  success = 0,            ///< reached t_end
  internal_error = 1,     ///< a bug in Undine
  bad_case = 2,           ///< command line or case file
  stopped = 3,            ///< stopped on request, checkpoint written
  bad_input_file = 4,     ///< a mesh or table cannot be read or is invalid
  numerical_failure = 10, ///< inverted element, time step below its limit, energy limit
  output_failed = 11,     ///< disk full or not writable
  check_failed = 20,      ///< --check found errors
  mpi_start_incomplete = 31,
  no_hello = 32,
  wrong_protocol = 33,
  different_case = 34,
  missing_role = 35,
  partner_silent = 36,
  message_out_of_order = 37,
  partner_failed = 40
};

/// Base of all failures a user may meet: a text for people and the exit code of the program.
class Failure : public std::runtime_error
{
public:
  Failure(ExitCode code, const std::string& text) : std::runtime_error(text), code_(code) {}
  ExitCode code() const { return code_; }

private:
  ExitCode code_;
};

/// The user's mistake: place, key, value, rule, and what to do about it.
class InputError : public Failure
{
public:
  explicit InputError(const std::string& text, ExitCode code = ExitCode::bad_case) : Failure(code, text) {}
};

/// A number gone bad while stepping: quantity, element or node, position, step, time.
class NumericalError : public Failure
{
public:
  explicit NumericalError(const std::string& text) : Failure(ExitCode::numerical_failure, text) {}
};

/// Our own promise broken. Stays on in release builds where silence would corrupt results.
class InternalError : public Failure
{
public:
  explicit InternalError(const std::string& text) : Failure(ExitCode::internal_error, text) {}
};

/// Throws InternalError with the source position if `condition` does not hold.
inline void require(bool condition, const char* what,
                    std::source_location where = std::source_location::current())
{
  if (!condition)
    throw InternalError(std::string(where.file_name()) + ":" + std::to_string(where.line()) + ": " + what);
}

} // namespace undine
