// CGAL's plane Delaunay triangulation.
#include "fluid_pfem/remesh/delaunay.hpp"

#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <array>
#include <utility>

namespace undine::fluid
{

namespace
{

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

Kernel::Point_2 point(const Vec<2>& x) { return {x[0], x[1]}; }

} // namespace

std::vector<Simplex<2>> delaunay(std::span<const Vec<2>> x)
{
  using Structure =
      CGAL::Triangulation_data_structure_2<CGAL::Triangulation_vertex_base_with_info_2<index_t, Kernel>>;
  using Triangulation = CGAL::Delaunay_triangulation_2<Kernel, Structure>;

  std::vector<std::pair<Kernel::Point_2, index_t>> points;
  points.reserve(x.size());
  for (std::size_t n = 0; n < x.size(); ++n)
    points.emplace_back(Kernel::Point_2(x[n][0], x[n][1]), static_cast<index_t>(n));
  const Triangulation triangulation(points.begin(), points.end());

  std::vector<Simplex<2>> simplices;
  simplices.reserve(triangulation.number_of_faces());
  for (auto face = triangulation.finite_faces_begin(); face != triangulation.finite_faces_end(); ++face)
    simplices.push_back({face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()});
  return simplices;
}

int exact_orientation(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c)
{
  return static_cast<int>(CGAL::orientation(point(a), point(b), point(c)));
}

int exact_in_circle(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c, const Vec<2>& d)
{
  const auto side = CGAL::side_of_oriented_circle(point(a), point(b), point(c), point(d));
  if (side != CGAL::ON_ORIENTED_BOUNDARY)
    return static_cast<int>(side);
  // Cocircular: as if each point were lifted off the paraboloid by an infinitesimal, more the later it comes
  // in lexicographic order. The first of them whose factor in the determinant does not vanish decides.
  std::array<const Vec<2>*, 4> points{&a, &b, &c, &d};
  std::sort(points.begin(), points.end(),
            [](const Vec<2>* p, const Vec<2>* q)
            { return (*p)[0] != (*q)[0] ? (*p)[0] < (*q)[0] : (*p)[1] < (*q)[1]; });
  for (std::size_t k = 3; k > 0; --k)
  {
    if (points[k] == &d)
      return -1;
    const int factor = points[k] == &c   ? exact_orientation(a, b, d)
                       : points[k] == &b ? exact_orientation(a, d, c)
                                         : exact_orientation(d, b, c);
    if (factor != 0)
      return factor;
  }
  return -1;
}

} // namespace undine::fluid
