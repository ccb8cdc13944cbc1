// What a mistake says.
#pragma once

#include "common/error.hpp"

#include <catch2/catch.hpp>

#include <string>

namespace undine::test
{

/// The text of the InputError of a bad case that `action` throws; "" if it throws none.
template <class Action>
std::string error_of(Action&& action)
{
  try
  {
    action();
  }
  catch (const InputError& error)
  {
    CHECK(error.code() == ExitCode::bad_case);
    return error.what();
  }
  return "";
}

} // namespace undine::test
