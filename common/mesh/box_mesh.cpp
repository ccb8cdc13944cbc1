// Structured meshes of boxes, for tests and for cases that need no mesh file.
#include "common/error.hpp"
#include "common/mesh/mesh.hpp"

#include <algorithm>
#include <array>

namespace undine
{

namespace
{

/// The grid of nodes of a box: node (i, j, k) has number i + (nx+1) (j + (ny+1) k).
template <int dim>
struct Grid
{
  std::array<int, dim> cells;

  index_t node(const std::array<int, dim>& i) const
  {
    index_t number = 0;
    for (int d = dim - 1; d >= 0; --d)
      number = number * (cells[d] + 1) + i[d];
    return number;
  }

  /// Call `visit` with the index of every point of the box [0, count), first index fastest.
  template <class Visitor>
  static void for_each(const std::array<int, dim>& count, Visitor&& visit)
  {
    std::array<int, dim> i{};
    while (i[dim - 1] < count[dim - 1])
    {
      visit(i);
      ++i[0];
      for (int d = 0; d + 1 < dim && i[d] == count[d]; ++d)
      {
        i[d] = 0;
        ++i[d + 1];
      }
    }
  }

  /// Corner `c` of cell `i`: bit d of `c` steps along axis d.
  index_t corner(std::array<int, dim> i, int c) const
  {
    for (int d = 0; d < dim; ++d)
      i[d] += (c >> d) & 1;
    return node(i);
  }
};

/// Cells as lists of corners (bit d: step along axis d), with positive Jacobians.
/// The six tetrahedra are Kuhn's (1960): all share the diagonal 0-7, and the triangulations of facing cells
/// agree.
std::vector<std::vector<int>> cell_patterns(ElementType type)
{
  switch (type)
  {
  case ElementType::triangle3:
    return {{0, 1, 3}, {0, 3, 2}};
  case ElementType::quadrilateral4:
    return {{0, 1, 3, 2}};
  case ElementType::tetrahedron4:
    return {{0, 1, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 3, 2, 7}, {0, 5, 1, 7}, {0, 6, 4, 7}};
  case ElementType::hexahedron8:
    return {{0, 1, 3, 2, 4, 5, 7, 6}};
  default:
    throw InternalError("box_mesh: no such element");
  }
}

/// Name of the side at the lower (0) or upper (1) end of an axis; y is the vertical.
const char* side_name(int axis, int end)
{
  static constexpr const char* names[3][2] = {{"left", "right"}, {"bottom", "top"}, {"back", "front"}};
  return names[axis][end];
}

template <int dim>
void name_sides(const Grid<dim>& grid, const Surface& boundary, Mesh<dim>& mesh)
{
  const auto on_side = [&grid](index_t node, int axis, int end)
  {
    for (int d = 0; d < axis; ++d)
      node /= grid.cells[d] + 1;
    return node % (grid.cells[axis] + 1) == (end == 0 ? 0 : grid.cells[axis]);
  };
  for (int axis = 0; axis < dim; ++axis)
    for (int end = 0; end < 2; ++end)
    {
      Surface& side = mesh.surfaces[side_name(axis, end)];
      for (std::size_t f = 0; f + 1 < boundary.offset.size(); ++f)
      {
        const auto first = boundary.nodes.begin() + boundary.offset[f];
        const auto last = boundary.nodes.begin() + boundary.offset[f + 1];
        if (!std::all_of(first, last, [&](index_t n) { return on_side(n, axis, end); }))
          continue;
        side.nodes.insert(side.nodes.end(), first, last);
        side.offset.push_back(static_cast<index_t>(side.nodes.size()));
      }
    }
}

} // namespace

template <int dim>
Mesh<dim> box_mesh(const Vec<dim>& origin, const Vec<dim>& size,
                   const std::array<int, static_cast<std::size_t>(dim)>& cells, ElementType type)
{
  require(element_dimension(type) == dim, "box_mesh: the element must have the dimension of the box");
  std::array<int, dim> points = cells;
  for (int d = 0; d < dim; ++d)
  {
    require(cells[d] > 0 && size[d] > 0.0, "box_mesh: at least one cell along each axis of positive length");
    ++points[d];
  }
  const Grid<dim> grid{cells};
  Mesh<dim> mesh;
  Grid<dim>::for_each(points,
                      [&](const std::array<int, dim>& i)
                      {
                        Vec<dim> x;
                        for (int d = 0; d < dim; ++d)
                          x[d] = origin[d] + size[d] * (static_cast<double>(i[d]) / cells[d]);
                        mesh.x.push_back(x);
                      });
  ElementBlock block;
  block.type = type;
  const auto patterns = cell_patterns(type);
  Grid<dim>::for_each(cells,
                      [&](const std::array<int, dim>& i)
                      {
                        for (const auto& pattern : patterns)
                          for (const int corner : pattern)
                            block.nodes.push_back(grid.corner(i, corner));
                      });
  mesh.blocks.push_back(std::move(block));
  name_sides(grid, boundary_of(mesh), mesh);
  return mesh;
}

template Mesh<2> box_mesh(const Vec<2>&, const Vec<2>&, const std::array<int, 2>&, ElementType);
template Mesh<3> box_mesh(const Vec<3>&, const Vec<3>&, const std::array<int, 3>&, ElementType);

} // namespace undine
