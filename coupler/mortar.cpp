// Exact segmentation and the dual basis.
#include "coupler/mortar.hpp"

#include "common/error.hpp"
#include "coupler/helpers.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

namespace undine::coupler
{

template <int dim>
Vec<dim> InterfaceFaces<dim>::normal(const std::vector<int>& f) const
{
  Vec<dim> n;
  if constexpr (dim == 2)
    n = right_normal(x[f[1]] - x[f[0]]);
  else
  {
    const Vec<3> diagonal_a = x[f[2]] - x[f[0]];
    const Vec<3> diagonal_b = f.size() == 4 ? x[f[3]] - x[f[1]] : x[f[2]] - x[f[1]];
    n = cross(diagonal_a, diagonal_b);
  }
  return n * (1.0 / norm(n));
}

template <int dim>
double InterfaceFaces<dim>::measure(const std::vector<int>& f) const
{
  if constexpr (dim == 2)
    return norm(x[f[1]] - x[f[0]]);
  else if (f.size() == 4)
    return 0.5 * norm(cross(x[f[2]] - x[f[0]], x[f[3]] - x[f[1]]));
  else
    return 0.5 * norm(cross(x[f[1]] - x[f[0]], x[f[2]] - x[f[0]]));
}

template <int dim>
double InterfaceFaces<dim>::total_measure() const
{
  return std::accumulate(faces.begin(), faces.end(), 0.0,
                         [this](double sum, const std::vector<int>& f) { return sum + measure(f); });
}

template <int dim>
double InterfaceFaces<dim>::mean_face_size() const
{
  const double mean = faces.empty() ? 0.0 : total_measure() / static_cast<double>(faces.size());
  return dim == 2 ? mean : std::sqrt(mean);
}

template <int dim>
InterfaceFaces<dim> faces_of(const link::SurfaceMesh& surface, const std::string& name)
{
  InterfaceFaces<dim> result;
  const auto known = std::find(surface.interfaces.begin(), surface.interfaces.end(), name);
  if (known == surface.interfaces.end())
    throw InputError("interface '" + name + "' is unknown to a participant");
  const auto index = static_cast<std::int32_t>(known - surface.interfaces.begin());

  result.x.resize(static_cast<std::size_t>(surface.n_nodes()));
  for (std::size_t n = 0; n < result.x.size(); ++n)
    for (int i = 0; i < dim; ++i)
      result.x[n][i] = surface.x[n * dim + static_cast<std::size_t>(i)];
  for (std::size_t f = 0; f < surface.face_interface.size(); ++f)
    if (surface.face_interface[f] == index)
      result.faces.emplace_back(surface.face_nodes.begin() + surface.face_offset[f],
                                surface.face_nodes.begin() + surface.face_offset[f + 1]);
  return result;
}

namespace
{

/// Unit normals at the nodes of `side`: faces' normals averaged with their measure.
template <int dim>
std::vector<Vec<dim>> nodal_normals(const InterfaceFaces<dim>& side)
{
  std::vector<Vec<dim>> n(side.x.size());
  for (const auto& face : side.faces)
    for (const int a : face)
      n[static_cast<std::size_t>(a)] += side.measure(face) * side.normal(face);
  for (auto& v : n)
    if (const double length = norm(v); length > 0.0)
      v *= 1.0 / length;
  return n;
}

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

/// A quadrature point common to a multiplier face and an other face.
struct CommonPoint
{
  double weight = 0.0;                  ///< includes the measure of the multiplier face
  std::array<double, 4> N_multiplier{}; ///< shape functions of the multiplier face
  std::array<double, 4> N_other{};
  double gap = 0.0;
};

/// Gauss points (3, exact to degree 5) of the segment shared by multiplier face m and other face o.
std::vector<CommonPoint> common_points(const InterfaceFaces<2>& multiplier, const std::vector<Vec<2>>& n,
                                       const std::vector<int>& m, const InterfaceFaces<2>& other,
                                       const std::vector<int>& o)
{
  const Vec<2>&a = multiplier.x[m[0]], &b = multiplier.x[m[1]], &n_a = n[m[0]], &n_b = n[m[1]];
  const Vec<2>&p = other.x[o[0]], &q = other.x[o[1]];
  const double xi_p = project_along_normals(p, a, b, n_a, n_b),
               xi_q = project_along_normals(q, a, b, n_a, n_b);
  const double begin = std::max(0.0, std::min(xi_p, xi_q)), end = std::min(1.0, std::max(xi_p, xi_q));
  std::vector<CommonPoint> points;
  if (!(end - begin > 1e-12))
    return points;

  static constexpr std::array<double, 3> abscissa{-0.7745966692414834, 0.0, 0.7745966692414834};
  static constexpr std::array<double, 3> weight{5.0 / 9.0, 8.0 / 9.0, 5.0 / 9.0};
  const double length = norm(b - a);
  for (std::size_t g = 0; g < 3; ++g)
  {
    const double xi = 0.5 * (begin + end) + 0.5 * (end - begin) * abscissa[g];
    const Vec<2> x = a + xi * (b - a), direction = n_a + xi * (n_b - n_a);
    const double eta = std::clamp(project_along(x, direction, p, q), 0.0, 1.0);
    points.push_back({.weight = 0.5 * (end - begin) * weight[g] * length,
                      .N_multiplier = {1.0 - xi, xi},
                      .N_other = {1.0 - eta, eta},
                      .gap = norm(p + eta * (q - p) - x)});
  }
  return points;
}

/// Polygon clipping in the plane through the multiplier facet; one triangle of a fan at a time.
std::vector<CommonPoint> common_points(const InterfaceFaces<3>& multiplier, const std::vector<Vec<3>>& n,
                                       const std::vector<int>& m, const InterfaceFaces<3>& other,
                                       const std::vector<int>& o);

template <int dim>
struct Box
{
  Vec<dim> lower, upper;

  bool meets(const Box& b) const
  {
    for (int i = 0; i < dim; ++i)
      if (upper[i] < b.lower[i] || b.upper[i] < lower[i])
        return false;
    return true;
  }
};

template <int dim>
Box<dim> box_of(const InterfaceFaces<dim>& side, const std::vector<int>& face, double margin)
{
  Box<dim> box{side.x[face[0]], side.x[face[0]]};
  for (const int a : face)
    for (int i = 0; i < dim; ++i)
    {
      box.lower[i] = std::min(box.lower[i], side.x[a][i]);
      box.upper[i] = std::max(box.upper[i], side.x[a][i]);
    }
  for (int i = 0; i < dim; ++i)
  {
    box.lower[i] -= margin;
    box.upper[i] += margin;
  }
  return box;
}

/// Pairs of faces of `a` from `begin` to `end` and faces of `b` whose boxes meet: sweep along the first axis.
template <int dim>
std::vector<std::vector<int>> candidate_pairs(const InterfaceFaces<dim>& a, const InterfaceFaces<dim>& b,
                                              double margin, std::size_t begin, std::size_t end)
{
  std::vector<Box<dim>> box_b;
  for (const auto& face : b.faces)
    box_b.push_back(box_of(b, face, 0.0));
  std::vector<int> order(b.faces.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int i, int j) { return box_b[i].lower[0] < box_b[j].lower[0]; });
  double widest = 0.0;
  for (const auto& box : box_b)
    widest = std::max(widest, box.upper[0] - box.lower[0]);

  std::vector<std::vector<int>> pairs(end - begin);
  for (std::size_t f = begin; f < end; ++f)
  {
    const Box<dim> box = box_of(a, a.faces[f], margin);
    auto& met = pairs[f - begin];
    auto it = std::lower_bound(order.begin(), order.end(), box.lower[0] - widest,
                               [&](int i, double value) { return box_b[i].lower[0] < value; });
    for (; it != order.end() && box_b[*it].lower[0] <= box.upper[0]; ++it)
      if (box.meets(box_b[*it]))
        met.push_back(*it);
    std::sort(met.begin(), met.end());
  }
  return pairs;
}

/// What faces of the multiplier side give to D and C, one face after the other.
struct FaceParts
{
  std::vector<std::int32_t> face;          ///< those that meet the other side
  std::vector<double> measure;             ///< of the common part
  std::vector<double> D;                   ///< ∫ N, one number per node of each face
  std::vector<std::int32_t> n_nodes, node; ///< of the other side: how many for each face, which
  std::vector<double> C;                   ///< for each of these nodes one number per node of the face
  double largest_gap = 0.0;
};

template <int dim>
FaceParts integrate_faces(const InterfaceFaces<dim>& multiplier, const InterfaceFaces<dim>& other,
                          double search_distance, std::size_t begin, std::size_t end)
{
  const auto normals = nodal_normals(multiplier);
  const auto pairs = candidate_pairs(multiplier, other, search_distance, begin, end);
  FaceParts parts;
  std::map<int, std::array<double, 4>> C; // of one face
  for (std::size_t f = begin; f < end; ++f)
  {
    const auto& m = multiplier.faces[f];
    const auto k = static_cast<Eigen::Index>(m.size());
    const Vec<dim> n_m = multiplier.normal(m);
    std::vector<std::pair<int, std::vector<CommonPoint>>> shared;
    Eigen::MatrixXd N_N = Eigen::MatrixXd::Zero(k, k); // ∫ N Nᵀ over the common part
    Eigen::VectorXd N_1 = Eigen::VectorXd::Zero(k);    // ∫ N
    double measure = 0.0;
    for (const int o : pairs[f - begin])
    {
      if (dot(n_m, other.normal(other.faces[o])) > -0.1)
        continue;
      auto points = common_points(multiplier, normals, m, other, other.faces[o]);
      std::erase_if(points, [&](const CommonPoint& p) { return p.gap > search_distance; });
      if (points.empty())
        continue;
      for (const auto& p : points)
      {
        const Eigen::Map<const Eigen::VectorXd> N(p.N_multiplier.data(), k);
        N_N += p.weight * N * N.transpose();
        N_1 += p.weight * N;
        measure += p.weight;
        parts.largest_gap = std::max(parts.largest_gap, p.gap);
      }
      shared.emplace_back(o, std::move(points));
    }
    if (measure <= 1e-10 * multiplier.measure(m))
      continue;
    // Ψ = A N with ∫ Ψ_a N_b = δ_ab ∫ N_a over the *common* part, so that partly covered faces keep the
    // duality.
    const Eigen::MatrixXd A = N_N.ldlt().solve(Eigen::MatrixXd(N_1.asDiagonal())).transpose();
    C.clear();
    for (const auto& [o, points] : shared)
      for (const auto& p : points)
      {
        const Eigen::VectorXd Psi = A * Eigen::Map<const Eigen::VectorXd>(p.N_multiplier.data(), k);
        for (std::size_t c = 0; c < other.faces[o].size(); ++c)
        {
          auto& of_node = C[other.faces[o][c]];
          for (Eigen::Index a = 0; a < k; ++a)
            of_node[static_cast<std::size_t>(a)] += p.weight * Psi[a] * p.N_other[c];
        }
      }
    parts.face.push_back(static_cast<std::int32_t>(f));
    parts.measure.push_back(measure);
    parts.D.insert(parts.D.end(), N_1.data(), N_1.data() + k);
    parts.n_nodes.push_back(static_cast<std::int32_t>(C.size()));
    for (const auto& [node, values] : C)
    {
      parts.node.push_back(node);
      parts.C.insert(parts.C.end(), values.begin(), values.begin() + k);
    }
  }
  return parts;
}

void write(link::wire::Writer& out, const FaceParts& p)
{
  out.list<std::int32_t>(p.face);
  out.list<double>(p.measure);
  out.list<double>(p.D);
  out.list<std::int32_t>(p.n_nodes);
  out.list<std::int32_t>(p.node);
  out.list<double>(p.C);
  out.f64(p.largest_gap);
}

FaceParts read_face_parts(link::wire::Reader in)
{
  FaceParts p;
  p.face = in.i32_list("face");
  p.measure = in.f64_list("measure");
  p.D = in.f64_list("D");
  p.n_nodes = in.i32_list("n_nodes");
  p.node = in.i32_list("node");
  p.C = in.f64_list("C");
  p.largest_gap = in.f64("largest_gap");
  in.end();
  return p;
}

template <int dim>
void write(link::wire::Writer& out, const InterfaceFaces<dim>& side)
{
  std::vector<double> x;
  for (const auto& point : side.x)
    x.insert(x.end(), point.c.begin(), point.c.end());
  std::vector<std::int32_t> size, node;
  for (const auto& face : side.faces)
  {
    size.push_back(static_cast<std::int32_t>(face.size()));
    node.insert(node.end(), face.begin(), face.end());
  }
  out.list<double>(x);
  out.list<std::int32_t>(size);
  out.list<std::int32_t>(node);
}

template <int dim>
InterfaceFaces<dim> read_faces(link::wire::Reader& in)
{
  InterfaceFaces<dim> side;
  const auto x = in.f64_list("x");
  const auto size = in.i32_list("face sizes"), node = in.i32_list("face nodes");
  side.x.resize(x.size() / dim);
  for (std::size_t n = 0; n < side.x.size(); ++n)
    std::copy_n(x.begin() + static_cast<std::ptrdiff_t>(n * dim), dim, side.x[n].c.begin());
  auto from = node.begin();
  for (const std::int32_t n : size)
  {
    side.faces.emplace_back(from, from + n);
    from += n;
  }
  return side;
}

/// The stretch of `n` faces of rank r of `size`.
std::array<std::size_t, 2> stretch(std::size_t n, int r, int size)
{
  const auto begin = [&](int k) { return n * static_cast<std::size_t>(k) / static_cast<std::size_t>(size); };
  return {begin(r), begin(r + 1)};
}

template <int dim>
std::vector<FaceParts> integrate_with(const link::Team& team, const InterfaceFaces<dim>& multiplier,
                                      const InterfaceFaces<dim>& other, double search_distance)
{
  std::vector<std::byte> task;
  link::wire::Writer out(task);
  out.i32(static_cast<std::int32_t>(dim == 2 ? Task::integrals_2d : Task::integrals_3d));
  out.f64(search_distance);
  write(out, multiplier);
  write(out, other);
  team.tell(std::move(task));
  const auto [begin, end] = stretch(multiplier.faces.size(), 0, team.size());
  std::vector<FaceParts> parts{integrate_faces(multiplier, other, search_distance, begin, end)};
  const auto found = team.collect({});
  for (std::size_t r = 1; r < found.size(); ++r)
    parts.push_back(read_face_parts(
        link::wire::Reader(found[r], "mortar of rank " + std::to_string(r) + " of the coupler")));
  return parts;
}

} // namespace

template <int dim>
void help_to_integrate(const link::Team& team, link::wire::Reader in)
{
  const double search_distance = in.f64("search distance");
  const auto multiplier = read_faces<dim>(in), other = read_faces<dim>(in);
  const auto [begin, end] = stretch(multiplier.faces.size(), team.rank(), team.size());
  std::vector<std::byte> answer;
  link::wire::Writer out(answer);
  write(out, integrate_faces(multiplier, other, search_distance, begin, end));
  team.collect(answer);
}

template <int dim>
Mortar<dim> integrate_mortar(const InterfaceFaces<dim>& multiplier, const InterfaceFaces<dim>& other,
                             double search_distance, const link::Team* team)
{
  const bool share =
      team != nullptr && team->size() > 1 && multiplier.faces.size() >= faces_worth_sharing<dim>;
  const std::vector<FaceParts> all =
      share ? integrate_with(*team, multiplier, other, search_distance)
            : std::vector{integrate_faces(multiplier, other, search_distance, 0, multiplier.faces.size())};

  std::map<int, double> D;
  std::map<int, std::map<int, double>> C;
  Mortar<dim> mortar;
  double common_measure = 0.0;
  for (const FaceParts& parts : all)
  {
    mortar.largest_gap = std::max(mortar.largest_gap, parts.largest_gap);
    std::size_t d = 0, at = 0, c = 0; // next numbers of D, node and C
    for (std::size_t k = 0; k < parts.face.size(); ++k)
    {
      common_measure += parts.measure[k];
      const auto& m = multiplier.faces[static_cast<std::size_t>(parts.face[k])];
      for (const int a : m)
        D[a] += parts.D[d++];
      for (std::int32_t i = 0; i < parts.n_nodes[k]; ++i, ++at)
        for (const int a : m)
          C[a][parts.node[at]] += parts.C[c++];
    }
  }
  const auto normals = nodal_normals(multiplier);
  for (const auto& [node, d] : D)
  {
    mortar.multiplier_node.push_back(node);
    mortar.normal.push_back(normals[static_cast<std::size_t>(node)]);
    mortar.D.push_back(d);
    mortar.C.emplace_back(C[node].begin(), C[node].end());
  }
  mortar.covered = {common_measure / multiplier.total_measure(), common_measure / other.total_measure()};
  return mortar;
}

template <int dim>
void append_constraints(const Mortar<dim>& mortar, Side multiplier_side, InterfaceKind kind,
                        ConstraintRows& rows)
{
  auto& own = rows.entries[multiplier_side];
  auto& partner = rows.entries[other(multiplier_side)];
  const auto add_row = [&](std::size_t a, const Vec<dim>& direction)
  {
    for (int i = 0; i < dim; ++i)
    {
      if (direction[i] == 0.0)
        continue;
      own.emplace_back(rows.count, dim * mortar.multiplier_node[a] + i, mortar.D[a] * direction[i]);
      for (const auto& [node, c] : mortar.C[a])
        partner.emplace_back(rows.count, dim * node + i, -c * direction[i]);
    }
    ++rows.count;
  };
  for (std::size_t a = 0; a < mortar.D.size(); ++a)
    if (kind == InterfaceKind::slip)
      add_row(a, mortar.normal[a]);
    else
      for (int i = 0; i < dim; ++i)
      {
        Vec<dim> e{};
        e[i] = 1.0;
        add_row(a, e);
      }
}

namespace
{

/// A convex polygon in the plane of a multiplier facet.
using Polygon = std::vector<Vec<2>>;

double signed_area(const Polygon& p)
{
  double twice = 0.0;
  for (std::size_t i = 0; i < p.size(); ++i)
  {
    const Vec<2>&a = p[i], &b = p[(i + 1) % p.size()];
    twice += a[0] * b[1] - a[1] * b[0];
  }
  return 0.5 * twice;
}

/// Sutherland-Hodgman: the part of `subject` inside the convex, counter-clockwise `window`.
Polygon clip(Polygon subject, const Polygon& window)
{
  for (std::size_t i = 0; i < window.size() && !subject.empty(); ++i)
  {
    const Vec<2>&a = window[i], &b = window[(i + 1) % window.size()];
    const auto side = [&](const Vec<2>& p)
    { return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]); };
    Polygon result;
    for (std::size_t k = 0; k < subject.size(); ++k)
    {
      const Vec<2>&p = subject[k], &q = subject[(k + 1) % subject.size()];
      const double s_p = side(p), s_q = side(q);
      if (s_p >= 0.0)
        result.push_back(p);
      if ((s_p > 0.0 && s_q < 0.0) || (s_p < 0.0 && s_q > 0.0))
        result.push_back(p + (s_p / (s_p - s_q)) * (q - p));
    }
    subject = std::move(result);
  }
  return subject;
}

/// Shape functions of a (projected) triangle or quadrilateral at a point of its plane.
std::array<double, 4> shape_functions_at(const Polygon& face, const Vec<2>& p)
{
  if (face.size() == 3)
  {
    const double area = signed_area(face);
    std::array<double, 4> N{};
    for (std::size_t a = 0; a < 3; ++a)
      N[a] = signed_area({p, face[(a + 1) % 3], face[(a + 2) % 3]}) / area;
    return N;
  }
  double xi = 0.0, eta = 0.0;
  std::array<double, 4> N{};
  for (int iteration = 0; iteration < 20; ++iteration)
  {
    N = {0.25 * (1 - xi) * (1 - eta), 0.25 * (1 + xi) * (1 - eta), 0.25 * (1 + xi) * (1 + eta),
         0.25 * (1 - xi) * (1 + eta)};
    const std::array<double, 4> dN_xi{-0.25 * (1 - eta), 0.25 * (1 - eta), 0.25 * (1 + eta),
                                      -0.25 * (1 + eta)};
    const std::array<double, 4> dN_eta{-0.25 * (1 - xi), -0.25 * (1 + xi), 0.25 * (1 + xi), 0.25 * (1 - xi)};
    Vec<2> r = p;
    Mat<2> J;
    for (std::size_t a = 0; a < 4; ++a)
    {
      r -= N[a] * face[a];
      for (int i = 0; i < 2; ++i)
      {
        J(i, 0) += dN_xi[a] * face[a][i];
        J(i, 1) += dN_eta[a] * face[a][i];
      }
    }
    const Vec<2> step = inverse(J) * r;
    xi += step[0];
    eta += step[1];
    if (norm(step) < 1e-15)
      break;
  }
  return {0.25 * (1 - xi) * (1 - eta), 0.25 * (1 + xi) * (1 - eta), 0.25 * (1 + xi) * (1 + eta),
          0.25 * (1 - xi) * (1 + eta)};
}

std::vector<CommonPoint> common_points(const InterfaceFaces<3>& multiplier, const std::vector<Vec<3>>&,
                                       const std::vector<int>& m, const InterfaceFaces<3>& other,
                                       const std::vector<int>& o)
{
  const Vec<3> n = multiplier.normal(m), origin = multiplier.x[m[0]];
  Vec<3> e_1 = multiplier.x[m[1]] - origin;
  e_1 = e_1 - dot(e_1, n) * n;
  e_1 *= 1.0 / norm(e_1);
  const Vec<3> e_2 = cross(n, e_1);
  const auto in_plane = [&](const InterfaceFaces<3>& side, const std::vector<int>& face, bool reverse)
  {
    Polygon p;
    for (const int a : face)
      p.push_back({{dot(side.x[a] - origin, e_1), dot(side.x[a] - origin, e_2)}});
    if (reverse)
      std::reverse(p.begin(), p.end());
    return p;
  };
  const Polygon face_m = in_plane(multiplier, m, false), face_o = in_plane(other, o, false);
  const Polygon common = clip(in_plane(other, o, true), face_m);

  std::vector<CommonPoint> points;
  if (common.size() < 3 || signed_area(common) <= 1e-12 * signed_area(face_m))
    return points;
  // Fan of triangles from the centroid, six points each (exact to degree 4: products of two bilinear
  // functions).
  static constexpr double a_1 = 0.445948490915965, w_1 = 0.223381589678011, a_2 = 0.091576213509771,
                          w_2 = 0.109951743655322;
  static constexpr std::array<std::array<double, 4>, 6> rule{{{a_1, a_1, 1 - 2 * a_1, w_1},
                                                              {a_1, 1 - 2 * a_1, a_1, w_1},
                                                              {1 - 2 * a_1, a_1, a_1, w_1},
                                                              {a_2, a_2, 1 - 2 * a_2, w_2},
                                                              {a_2, 1 - 2 * a_2, a_2, w_2},
                                                              {1 - 2 * a_2, a_2, a_2, w_2}}};
  Vec<2> centre{};
  for (const auto& p : common)
    centre += (1.0 / static_cast<double>(common.size())) * p;
  for (std::size_t k = 0; k < common.size(); ++k)
  {
    const Polygon triangle{centre, common[k], common[(k + 1) % common.size()]};
    const double area = signed_area(triangle);
    if (area <= 0.0)
      continue;
    for (const auto& [l_0, l_1, l_2, w] : rule)
    {
      const Vec<2> p = l_0 * triangle[0] + l_1 * triangle[1] + l_2 * triangle[2];
      CommonPoint point{.weight = w * area,
                        .N_multiplier = shape_functions_at(face_m, p),
                        .N_other = shape_functions_at(face_o, p)};
      Vec<3> between{};
      for (std::size_t a = 0; a < m.size(); ++a)
        between += point.N_multiplier[a] * multiplier.x[m[a]];
      for (std::size_t a = 0; a < o.size(); ++a)
        between -= point.N_other[a] * other.x[o[a]];
      point.gap = norm(between);
      points.push_back(point);
    }
  }
  return points;
}

} // namespace

template struct InterfaceFaces<2>;
template struct InterfaceFaces<3>;
template InterfaceFaces<2> faces_of<2>(const link::SurfaceMesh&, const std::string&);
template InterfaceFaces<3> faces_of<3>(const link::SurfaceMesh&, const std::string&);
template Mortar<2> integrate_mortar<2>(const InterfaceFaces<2>&, const InterfaceFaces<2>&, double,
                                       const link::Team*);
template Mortar<3> integrate_mortar<3>(const InterfaceFaces<3>&, const InterfaceFaces<3>&, double,
                                       const link::Team*);
template void help_to_integrate<2>(const link::Team&, link::wire::Reader);
template void help_to_integrate<3>(const link::Team&, link::wire::Reader);
template void append_constraints<2>(const Mortar<2>&, Side, InterfaceKind, ConstraintRows&);
template void append_constraints<3>(const Mortar<3>&, Side, InterfaceKind, ConstraintRows&);

} // namespace undine::coupler
