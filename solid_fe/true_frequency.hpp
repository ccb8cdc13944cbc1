// The true highest frequency of the discrete solid, measured.
#pragma once

namespace undine::solid
{

template <int dim>
class Solid;

/// Highest eigenvalue of M⁻¹K at the current displacement [1/s²], from above by about a percent: Lanczos'
/// method, that is the best that k power iterations allow, with K v as a central difference of the internal
/// force, from a random start until the residual of the highest Ritz pair is 1 % of it; the residual and 1 %
/// more are added. Each iteration costs two internal forces; 15 to 60 are usual. Components with prescribed
/// motion take no part.
template <int dim>
double true_frequency_squared(const Solid<dim>& solid);

} // namespace undine::solid
