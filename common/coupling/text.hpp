// How numbers and places are written in messages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdio>
#include <string>

namespace undine::link
{

/// Six significant digits.
inline std::string number_text(double value)
{
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

/// Position of an entry in words that a reader of the mesh understands.
inline std::string entry(const char* field, std::size_t i)
{
  return std::string(field) + "[" + std::to_string(i) + "]";
}

} // namespace undine::link
