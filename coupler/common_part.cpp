// Segments and polygons that two faces share, and quadrature on them.
#include "coupler/common_part.hpp"

#include "common/lanes.hpp"

#include <algorithm>
#include <cmath>

namespace undine::coupler
{

namespace
{

/// Position ξ ∈ ℝ on the segment a → b (0 at a, 1 at b) whose interpolated normal passes through `p`.
/// Solves (p − x(ξ)) × n(ξ) = 0 by Newton from the orthogonal projection; exact in one step if n is constant.
double project_along_normals(const Vec<2>& p, const Vec<2>& a, const Vec<2>& b, const Vec<2>& n_a,
                             const Vec<2>& n_b)
{
  const auto cross_2d = [](const Vec<2>& u, const Vec<2>& v) { return u[0] * v[1] - u[1] * v[0]; };
  const Vec<2> t = b - a, dn = n_b - n_a;
  double xi = dot(p - a, t) / dot(t, t);
  for (int iteration = 0; iteration < 8; ++iteration)
  {
    const Vec<2> r = p - a - xi * t, n = n_a + xi * dn;
    const double value = cross_2d(r, n), slope = cross_2d(r, dn) - cross_2d(t, n);
    if (slope == 0.0)
      break;
    const double step = value / slope;
    xi -= step;
    if (std::abs(step) < 1e-15)
      break;
  }
  return xi;
}

/// Position on the segment a → b hit by the line through `p` with direction `n`.
double project_along(const Vec<2>& p, const Vec<2>& n, const Vec<2>& a, const Vec<2>& b)
{
  const Vec<2> t = b - a;
  const double denominator = t[0] * n[1] - t[1] * n[0];
  return ((p[0] - a[0]) * n[1] - (p[1] - a[1]) * n[0]) / denominator;
}

/// Of corners that go round counter-clockwise [m²]; else negative.
double signed_area(const auto& p)
{
  double twice = 0.0;
  for (std::size_t i = 0; i < p.size(); ++i)
  {
    const Vec<2>&a = p[i], &b = p[i + 1 < p.size() ? i + 1 : 0];
    twice += a[0] * b[1] - a[1] * b[0];
  }
  return 0.5 * twice;
}

using Triangle = std::array<Vec<2>, 3>;

/// Sutherland-Hodgman: the part of `subject` inside the convex, counter-clockwise `window`.
Polygon clip(Polygon subject, const Polygon& window)
{
  for (std::size_t i = 0; i < window.size() && subject.size() > 0; ++i)
  {
    const Vec<2>&a = window[i], &b = window[i + 1 < window.size() ? i + 1 : 0];
    const auto side = [&](const Vec<2>& p)
    { return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]); };
    Polygon result;
    for (std::size_t k = 0; k < subject.size(); ++k)
    {
      const Vec<2>&p = subject[k], &q = subject[k + 1 < subject.size() ? k + 1 : 0];
      const double s_p = side(p), s_q = side(q);
      if (s_p >= 0.0)
        result.push_back(p);
      if ((s_p > 0.0 && s_q < 0.0) || (s_p < 0.0 && s_q > 0.0))
        result.push_back(p + (s_p / (s_p - s_q)) * (q - p));
    }
    subject = result;
  }
  return subject;
}

/// Shape functions of a (projected) triangle or quadrilateral at points of its plane.
template <class Real>
std::array<Real, 4> shape_functions_at(const Polygon& face, const Vec<2, Real>& p)
{
  const auto corner = [&face](std::size_t a) { return Vec<2, Real>{{face[a][0], face[a][1]}}; };
  if (face.size() == 3)
  {
    const Vec<2, Real> u = corner(1) - corner(0), v = corner(2) - corner(0), r = p - corner(0);
    const Real scale = Real(1.0) / (u[0] * v[1] - u[1] * v[0]);
    const Real N_1 = scale * (r[0] * v[1] - r[1] * v[0]), N_2 = scale * (u[0] * r[1] - u[1] * r[0]);
    return {1.0 - N_1 - N_2, N_1, N_2, 0.0};
  }
  const auto N = [](const Real& xi, const Real& eta) -> std::array<Real, 4>
  {
    return {0.25 * (1.0 - xi) * (1.0 - eta), 0.25 * (1.0 + xi) * (1.0 - eta), 0.25 * (1.0 + xi) * (1.0 + eta),
            0.25 * (1.0 - xi) * (1.0 + eta)};
  };
  // x(ξ, η) = x₀ + ξ x_ξ + η x_η + ξη x_ξη, solved for ξ and η by Newton: one step for a parallelogram. What
  // a step leaves is of the order of its square.
  const Vec<2, Real> c_0 = corner(0), c_1 = corner(1), c_2 = corner(2), c_3 = corner(3);
  const Real quarter(0.25);
  const Vec<2, Real> x_0 = quarter * (c_0 + c_1 + c_2 + c_3), x_xi = quarter * (c_1 + c_2 - c_0 - c_3),
                     x_eta = quarter * (c_2 + c_3 - c_0 - c_1), x_xi_eta = quarter * (c_0 + c_2 - c_1 - c_3);
  Real xi(0.0), eta(0.0);
  for (int iteration = 0; iteration < 20; ++iteration)
  {
    const Vec<2, Real> along_xi = x_xi + eta * x_xi_eta, along_eta = x_eta + xi * x_xi_eta,
                       r = p - x_0 - xi * along_xi - eta * x_eta;
    const Real scale = Real(1.0) / (along_xi[0] * along_eta[1] - along_xi[1] * along_eta[0]),
               d_xi = scale * (r[0] * along_eta[1] - r[1] * along_eta[0]),
               d_eta = scale * (along_xi[0] * r[1] - along_xi[1] * r[0]);
    xi += d_xi;
    eta += d_eta;
    if (!any(d_xi * d_xi + d_eta * d_eta > Real(1e-24)))
      break;
  }
  return N(xi, eta);
}

} // namespace

MultiplierFace<2>::MultiplierFace(const InterfaceFaces<2>& side, const std::vector<Vec<2>>& nodal_normals,
                                  const std::vector<int>& face)
    : a_(side.x[face[0]]), b_(side.x[face[1]]), n_a_(nodal_normals[face[0]]), n_b_(nodal_normals[face[1]])
{
}

void MultiplierFace<2>::append_common_points(const InterfaceFaces<2>& other, const std::vector<int>& o,
                                             std::vector<CommonPoint>& points) const
{
  const Vec<2>&p = other.x[o[0]], &q = other.x[o[1]];
  const double xi_p = project_along_normals(p, a_, b_, n_a_, n_b_),
               xi_q = project_along_normals(q, a_, b_, n_a_, n_b_);
  const double begin = std::max(0.0, std::min(xi_p, xi_q)), end = std::min(1.0, std::max(xi_p, xi_q));
  if (!(end - begin > 1e-12))
    return;

  static constexpr std::array<double, 3> abscissa{-0.7745966692414834, 0.0, 0.7745966692414834};
  static constexpr std::array<double, 3> weight{5.0 / 9.0, 8.0 / 9.0, 5.0 / 9.0};
  const double length = norm(b_ - a_);
  for (std::size_t g = 0; g < 3; ++g)
  {
    const double xi = 0.5 * (begin + end) + 0.5 * (end - begin) * abscissa[g];
    const Vec<2> x = a_ + xi * (b_ - a_), direction = n_a_ + xi * (n_b_ - n_a_);
    const double eta = std::clamp(project_along(x, direction, p, q), 0.0, 1.0);
    points.push_back({.weight = 0.5 * (end - begin) * weight[g] * length,
                      .N_multiplier = {1.0 - xi, xi},
                      .N_other = {1.0 - eta, eta},
                      .gap = norm(p + eta * (q - p) - x)});
  }
}

void Polygon::reverse() { std::reverse(corner_.begin(), corner_.begin() + size_); }

Polygon MultiplierFace<3>::in_plane(const InterfaceFaces<3>& side, const std::vector<int>& face) const
{
  Polygon p;
  for (const int a : face)
    p.push_back({{dot(side.x[a] - origin_, e_1_), dot(side.x[a] - origin_, e_2_)}});
  return p;
}

MultiplierFace<3>::MultiplierFace(const InterfaceFaces<3>& side, const std::vector<Vec<3>>&,
                                  const std::vector<int>& face)
    : side_(side), face_(face), origin_(side.x[face[0]])
{
  const Vec<3> n = side.normal(face);
  e_1_ = side.x[face[1]] - origin_;
  e_1_ = e_1_ - dot(e_1_, n) * n;
  e_1_ *= 1.0 / norm(e_1_);
  e_2_ = cross(n, e_1_);
  polygon_ = in_plane(side, face);
  area_ = signed_area(polygon_);
}

void MultiplierFace<3>::append_common_points(const InterfaceFaces<3>& other, const std::vector<int>& o,
                                             std::vector<CommonPoint>& points) const
{
  const Polygon face_o = in_plane(other, o);
  Polygon subject = face_o;
  subject.reverse();
  const Polygon common = clip(subject, polygon_);
  if (common.size() < 3 || signed_area(common) <= 1e-12 * area_)
    return;
  static constexpr double a_1 = 0.445948490915965, w_1 = 0.223381589678011, a_2 = 0.091576213509771,
                          w_2 = 0.109951743655322;
  static constexpr std::array<std::array<double, 4>, 6> rule{{{a_1, a_1, 1 - 2 * a_1, w_1},
                                                              {a_1, 1 - 2 * a_1, a_1, w_1},
                                                              {1 - 2 * a_1, a_1, a_1, w_1},
                                                              {a_2, a_2, 1 - 2 * a_2, w_2},
                                                              {a_2, 1 - 2 * a_2, a_2, w_2},
                                                              {1 - 2 * a_2, a_2, a_2, w_2}}};
  // All points of the fan, then what is known at them, eight at a time.
  std::array<double, 6 * Polygon::most + Lanes::size> weight, p_0, p_1;
  int n = 0;
  for (std::size_t k = 1; k + 1 < common.size(); ++k)
  {
    const Triangle triangle{common[0], common[k], common[k + 1]};
    const double area = signed_area(triangle);
    if (area <= 0.0)
      continue;
    for (const auto& [l_0, l_1, l_2, w] : rule)
    {
      const Vec<2> p = l_0 * triangle[0] + l_1 * triangle[1] + l_2 * triangle[2];
      weight[n] = w * area;
      p_0[n] = p[0];
      p_1[n++] = p[1];
    }
  }
  for (int k = 0; k < n; k += Lanes::size)
  {
    const int count = std::min(Lanes::size, n - k);
    const Vec<2, Lanes> p{{load_lanes(&p_0[k], count), load_lanes(&p_1[k], count)}};
    const auto N_multiplier = shape_functions_at(polygon_, p), N_other = shape_functions_at(face_o, p);
    Vec<3, Lanes> between{};
    for (std::size_t a = 0; a < face_.size(); ++a)
      for (int i = 0; i < 3; ++i)
        between[i] += N_multiplier[a] * side_.x[face_[a]][i];
    for (std::size_t a = 0; a < o.size(); ++a)
      for (int i = 0; i < 3; ++i)
        between[i] -= N_other[a] * other.x[o[a]][i];
    const Lanes gap = sqrt(dot(between, between));
    for (int e = 0; e < count; ++e)
      points.push_back(
          {.weight = weight[k + e],
           .N_multiplier = {N_multiplier[0][e], N_multiplier[1][e], N_multiplier[2][e], N_multiplier[3][e]},
           .N_other = {N_other[0][e], N_other[1][e], N_other[2][e], N_other[3][e]},
           .gap = gap[e]});
  }
}

} // namespace undine::coupler
