// Exact segmentation and the dual basis.
#include "coupler/mortar.hpp"

#include "common/error.hpp"
#include "coupler/common_part.hpp"
#include "coupler/helpers.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <type_traits>

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

/// What belongs to a node, in a short list that is not sorted; zero at first.
template <class Value>
Value& entry_of(std::vector<std::pair<int, Value>>& of_nodes, int node)
{
  for (auto& [known, value] : of_nodes)
    if (known == node)
      return value;
  return of_nodes.emplace_back(node, Value{}).second;
}

void sort_by_node(auto& of_nodes)
{
  std::sort(of_nodes.begin(), of_nodes.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
}

/// A number per node of a face; in space of four, those beyond a triangle's are zero. (In the plane of a size
/// that the compiler does not know: so sums are rounded as in the recorded results.)
template <int dim>
using OfNodes = std::conditional_t<dim == 2, Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2, 1>,
                                   Eigen::Matrix<double, 4, 1>>;
template <int dim>
using OfPairs = std::conditional_t<dim == 2, Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2, 2>,
                                   Eigen::Matrix<double, 4, 4>>;

/// A of the dual functions Ψ = A N of a face with k nodes: ∫ Ψ_a N_b = δ_ab ∫ N_a over the *common* part, so
/// that partly covered faces keep the duality.
template <int dim>
OfPairs<dim> dual_basis(const OfPairs<dim>& N_N, const OfNodes<dim>& N_1, Eigen::Index k)
{
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 4, 4>;
  const Matrix of_face = N_N.topLeftCorner(k, k), right = N_1.head(k).asDiagonal();
  OfPairs<dim> A = OfPairs<dim>::Zero(N_N.rows(), N_N.cols());
  A.topLeftCorner(k, k) = of_face.ldlt().solve(right).transpose();
  return A;
}

template <int dim>
FaceParts integrate_faces(const InterfaceFaces<dim>& multiplier, const InterfaceFaces<dim>& other,
                          double search_distance, std::size_t begin, std::size_t end)
{
  const auto normals = nodal_normals(multiplier);
  const auto pairs = candidate_pairs(multiplier, other, search_distance, begin, end);
  std::vector<Vec<dim>> normals_o;
  for (const auto& face : other.faces)
    normals_o.push_back(other.normal(face));
  FaceParts parts;
  // Of one face of the multiplier side:
  struct Met
  {
    int face;
    std::size_t first, last; ///< of its points
  };
  std::vector<Met> met;
  std::vector<CommonPoint> points;
  std::vector<std::pair<int, std::array<double, 4>>> C; // by node of the other side
  for (std::size_t f = begin; f < end; ++f)
  {
    const auto& m = multiplier.faces[f];
    const auto k = static_cast<Eigen::Index>(m.size()), most = dim == 2 ? k : 4;
    const Vec<dim> n_m = multiplier.normal(m);
    const MultiplierFace<dim> window(multiplier, normals, m);
    points.clear();
    met.clear();
    OfPairs<dim> N_N = OfPairs<dim>::Zero(most, most); // ∫ N Nᵀ over the common part
    OfNodes<dim> N_1 = OfNodes<dim>::Zero(most);       // ∫ N
    double measure = 0.0;
    for (const int o : pairs[f - begin])
    {
      if (dot(n_m, normals_o[static_cast<std::size_t>(o)]) > -0.1)
        continue;
      const auto first = points.size();
      window.append_common_points(other, other.faces[o], points);
      points.erase(std::remove_if(points.begin() + static_cast<std::ptrdiff_t>(first), points.end(),
                                  [&](const CommonPoint& p) { return p.gap > search_distance; }),
                   points.end());
      if (points.size() > first)
        met.push_back({o, first, points.size()});
    }
    for (const CommonPoint& p : points)
    {
      const Eigen::Map<const OfNodes<dim>> N(p.N_multiplier.data(), most);
      N_N += p.weight * N * N.transpose();
      N_1 += p.weight * N;
      measure += p.weight;
      parts.largest_gap = std::max(parts.largest_gap, p.gap);
    }
    if (measure <= 1e-10 * multiplier.measure(m))
      continue;
    const OfPairs<dim> A = dual_basis<dim>(N_N, N_1, k);
    C.clear();
    for (const auto& [o, first, last] : met)
    {
      const auto& nodes = other.faces[o];
      for (const int c : nodes)
        entry_of(C, c);
      std::array<double*, 4> of_node{}; // these do not move any more
      for (std::size_t c = 0; c < nodes.size(); ++c)
        of_node[c] = entry_of(C, nodes[c]).data();
      for (std::size_t i = first; i < last; ++i)
      {
        const CommonPoint& p = points[i];
        const OfNodes<dim> Psi = A * Eigen::Map<const OfNodes<dim>>(p.N_multiplier.data(), most);
        for (std::size_t c = 0; c < nodes.size(); ++c)
          for (Eigen::Index a = 0; a < most; ++a)
            of_node[c][a] += p.weight * Psi[a] * p.N_other[c];
      }
    }
    sort_by_node(C);
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
  const bool share = team != nullptr && team->size() > 1 && multiplier.faces.size() >= faces_worth_sharing;
  const std::vector<FaceParts> all =
      share ? integrate_with(*team, multiplier, other, search_distance)
            : std::vector{integrate_faces(multiplier, other, search_distance, 0, multiplier.faces.size())};

  // By node of the multiplier side; a node without faces that meet the other side has nothing in C.
  std::vector<double> D(multiplier.x.size(), 0.0);
  std::vector<std::vector<std::pair<int, double>>> C(multiplier.x.size());
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
        D[static_cast<std::size_t>(a)] += parts.D[d++];
      for (std::int32_t i = 0; i < parts.n_nodes[k]; ++i, ++at)
        for (const int a : m)
          entry_of(C[static_cast<std::size_t>(a)], parts.node[at]) += parts.C[c++];
    }
  }
  const auto normals = nodal_normals(multiplier);
  for (std::size_t node = 0; node < C.size(); ++node)
  {
    if (C[node].empty())
      continue;
    sort_by_node(C[node]);
    mortar.multiplier_node.push_back(static_cast<int>(node));
    mortar.normal.push_back(normals[node]);
    mortar.D.push_back(D[node]);
    mortar.C.push_back(std::move(C[node]));
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
