// How numbers are written in messages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

} // namespace undine::link
