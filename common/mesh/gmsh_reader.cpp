// Reads Gmsh meshes: MSH 2.2 and 4.1, text and binary; turns elements and facets the right way round.
#include "common/error.hpp"
#include "common/mesh/facets.hpp"
#include "common/mesh/mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>
#include <unordered_map>

namespace undine
{

namespace
{

/// Elements as they stand in the file, before anything is known about bodies and surfaces.
struct RawElement
{
  std::int64_t number = 0;
  ElementType type = ElementType::line2;
  bool is_point = false;
  std::int64_t group = 0;     ///< physical group, 0 if none
  std::size_t first_node = 0; ///< position in `RawMesh::element_nodes`
};

struct RawMesh
{
  std::vector<std::int64_t> node_number;
  std::vector<std::array<double, 3>> x;
  std::vector<RawElement> elements;
  std::vector<std::int64_t> element_nodes;                         ///< node numbers of the file
  std::map<std::pair<int, std::int64_t>, std::string> group_names; ///< (dimension, number) → name

  std::string group_name(int dimension, std::int64_t number) const
  {
    const auto found = group_names.find({dimension, number});
    return found != group_names.end() ? found->second : std::to_string(number);
  }
};

int raw_dimension(const RawElement& element)
{
  return element.is_point ? 0 : element_dimension(element.type);
}
std::size_t raw_size(const RawElement& element)
{
  return element.is_point ? 1 : static_cast<std::size_t>(nodes_per_element(element.type));
}

/// "element 12 (physical group 'water')"
std::string name_of(const RawMesh& raw, const RawElement& element)
{
  if (element.group == 0)
    return fmt::format("element {} (no physical group)", element.number);
  return fmt::format("element {} (physical group '{}')", element.number,
                     raw.group_name(raw_dimension(element), element.group));
}

/// The bytes of the file with a read position; numbers come as text or as binary, as the header says.
class Cursor
{
public:
  Cursor(std::string path, std::string bytes) : path_(std::move(path)), bytes_(std::move(bytes)) {}

  bool binary = false;

  [[noreturn]] void fail(const std::string& text) const
  {
    throw InputError(path_ + ": " + text, ExitCode::bad_input_file);
  }
  [[noreturn]] void fail_short() const { fail(fmt::format("the file ends inside section ${}", section)); }

  std::string section = "MeshFormat"; ///< for messages

  /// The next word of the text parts; "" at the end of the file.
  std::string_view word()
  {
    skip_blanks();
    const std::size_t first = position_;
    while (position_ < bytes_.size() && !is_blank(bytes_[position_]))
      ++position_;
    return std::string_view(bytes_).substr(first, position_ - first);
  }

  /// A name in double quotes.
  std::string quoted()
  {
    skip_blanks();
    const std::size_t close = position_ < bytes_.size() && bytes_[position_] == '"'
                                  ? bytes_.find('"', position_ + 1)
                                  : std::string::npos;
    if (close == std::string::npos)
      fail(fmt::format("section ${}: a name in double quotes is expected", section));
    const std::string name = bytes_.substr(position_ + 1, close - position_ - 1);
    position_ = close + 1;
    return name;
  }

  template <class Number>
  Number text_number()
  {
    const std::string_view token = word();
    if (token.empty())
      fail_short();
    Number value{};
    const auto [end, code] = std::from_chars(token.data(), token.data() + token.size(), value);
    if (code != std::errc() || end != token.data() + token.size())
      fail(fmt::format("section ${}: '{}' is no {}", section, token,
                       std::is_floating_point_v<Number> ? "number" : "integer"));
    return value;
  }

  template <class Number>
  Number number()
  {
    if (!binary)
      return text_number<Number>();
    if (bytes_.size() - position_ < sizeof(Number))
      fail_short();
    Number value;
    std::memcpy(&value, bytes_.data() + position_, sizeof(Number));
    position_ += sizeof(Number);
    return value;
  }

  int small() { return number<int>(); }
  double real() { return number<double>(); }
  /// Counts and numbers that MSH 4.1 stores in 8 bytes.
  std::int64_t large() { return number<std::int64_t>(); }

  /// A count must fit into what is left of the file: a damaged file is reported, not obeyed.
  std::int64_t checked_count(std::int64_t count) const
  {
    if (count < 0 || static_cast<std::uint64_t>(count) > bytes_.size() - position_)
      fail(fmt::format("section ${}: {} entries cannot be right", section, count));
    return count;
  }

  /// Binary data begin behind the end of the line.
  void end_of_line()
  {
    if (!binary)
      return;
    if (position_ < bytes_.size() && bytes_[position_] == '\r')
      ++position_;
    if (position_ < bytes_.size() && bytes_[position_] == '\n')
      ++position_;
  }

  /// The next section, its name in `section`; false at the end of the file.
  bool open_section()
  {
    const std::string_view head = word();
    if (head.empty())
      return false;
    if (head[0] != '$')
      fail(fmt::format("a section such as $Nodes is expected behind ${}, not '{}'", section,
                       head.substr(0, 20)));
    section = std::string(head.substr(1));
    end_of_line();
    return true;
  }

  void close_section()
  {
    if (word() != "$End" + section)
      fail(fmt::format("section ${} does not end where its counts say", section));
  }

  void skip_section()
  {
    const std::size_t end = bytes_.find("$End" + section, position_);
    if (end == std::string::npos)
      fail_short();
    position_ = end + 4 + section.size();
  }

private:
  static bool is_blank(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }
  void skip_blanks()
  {
    while (position_ < bytes_.size() && is_blank(bytes_[position_]))
      ++position_;
  }

  std::string path_, bytes_;
  std::size_t position_ = 0;
};

/// Physical groups of a geometric entity (dimension, tag) of MSH 4.1.
using Entities = std::map<std::pair<int, int>, std::vector<std::int64_t>>;

struct ElementKind
{
  bool is_point;
  ElementType type;
};

/// Gmsh's number of an element type; nothing for those that Undine has no elements for.
std::optional<ElementKind> kind_of(int gmsh_type)
{
  switch (gmsh_type)
  {
  case 1:
    return ElementKind{false, ElementType::line2};
  case 2:
    return ElementKind{false, ElementType::triangle3};
  case 3:
    return ElementKind{false, ElementType::quadrilateral4};
  case 4:
    return ElementKind{false, ElementType::tetrahedron4};
  case 5:
    return ElementKind{false, ElementType::hexahedron8};
  case 15:
    return ElementKind{true, ElementType::line2};
  default:
    return std::nullopt;
  }
}

ElementKind kind_of(const Cursor& in, int gmsh_type, std::int64_t element_number)
{
  const auto kind = kind_of(gmsh_type);
  if (!kind)
    in.fail(
        fmt::format("element {} is of Gmsh type {}: only points, and 2-node lines, 3-node triangles, 4-node "
                    "quadrilaterals, 4-node tetrahedra and 8-node hexahedra are read (Mesh.ElementOrder = 1)",
                    element_number, gmsh_type));
  return *kind;
}

double read_format(Cursor& in)
{
  if (in.word() != "$MeshFormat")
    in.fail("is not a Gmsh mesh: it does not begin with $MeshFormat");
  const double version = in.text_number<double>();
  const int file_type = in.text_number<int>();
  const int data_size = in.text_number<int>();
  if (version != 2.2 && version != 4.1)
    in.fail(fmt::format("MSH version {}: write version 4.1 or 2.2 (gmsh -format msh41 or msh22)", version));
  if (data_size != 8)
    in.fail(fmt::format("data size {}: only 8 is read", data_size));
  if (file_type == 1)
  {
    in.binary = true;
    in.end_of_line();
    if (in.small() != 1)
      in.fail("the binary file comes from a machine of other byte order");
  }
  in.close_section();
  return version;
}

void read_group_names(Cursor& in, RawMesh& raw)
{
  const int count = in.text_number<int>();
  for (int i = 0; i < count; ++i)
  {
    const int dimension = in.text_number<int>();
    const int number = in.text_number<int>();
    raw.group_names[{dimension, number}] = in.quoted();
  }
}

Entities read_entities(Cursor& in)
{
  Entities entities;
  std::array<std::int64_t, 4> count{};
  for (auto& n : count)
    n = in.checked_count(in.large());
  for (int dimension = 0; dimension < 4; ++dimension)
    for (std::int64_t i = 0; i < count[static_cast<std::size_t>(dimension)]; ++i)
    {
      auto& groups = entities[{dimension, in.small()}];
      for (int c = 0; c < (dimension == 0 ? 3 : 6); ++c) // position or bounding box
        in.real();
      for (std::int64_t g = in.checked_count(in.large()); g > 0; --g)
        groups.push_back(std::abs(static_cast<std::int64_t>(in.small()))); // a sign would say "reversed"
      if (dimension > 0)
        for (std::int64_t b = in.checked_count(in.large()); b > 0; --b) // bounding entities
          in.small();
    }
  return entities;
}

void read_nodes_22(Cursor& in, RawMesh& raw)
{
  const std::int64_t count = in.checked_count(in.text_number<std::int64_t>());
  in.end_of_line();
  for (std::int64_t i = 0; i < count; ++i)
  {
    raw.node_number.push_back(in.small());
    auto& x = raw.x.emplace_back();
    for (double& component : x)
      component = in.real();
  }
}

void read_elements_22(Cursor& in, RawMesh& raw)
{
  const std::int64_t count = in.checked_count(in.text_number<std::int64_t>());
  in.end_of_line();
  const auto read_one = [&](std::int64_t number, int gmsh_type, int n_tags)
  {
    const ElementKind kind = kind_of(in, gmsh_type, number);
    RawElement element{.number = number,
                       .type = kind.type,
                       .is_point = kind.is_point,
                       .first_node = raw.element_nodes.size()};
    for (int t = 0; t < n_tags; ++t)
      if (const std::int64_t tag = in.small(); t == 0)
        element.group = std::abs(tag);
    for (std::size_t a = 0; a < raw_size(element); ++a)
      raw.element_nodes.push_back(in.small());
    raw.elements.push_back(element);
  };
  if (!in.binary)
    for (std::int64_t i = 0; i < count; ++i)
    {
      const std::int64_t number = in.small();
      const int gmsh_type = in.small();
      read_one(number, gmsh_type, in.small());
    }
  else
    for (std::int64_t done = 0; done < count;)
    {
      const int gmsh_type = in.small();
      const std::int64_t follow = in.checked_count(in.small());
      const int n_tags = in.small();
      for (std::int64_t i = 0; i < follow; ++i)
        read_one(in.small(), gmsh_type, n_tags);
      done += std::max<std::int64_t>(1, follow);
    }
}

void read_nodes_41(Cursor& in, RawMesh& raw)
{
  const std::int64_t blocks = in.checked_count(in.large());
  for (int i = 0; i < 3; ++i) // number of nodes, smallest and largest number
    in.large();
  for (std::int64_t b = 0; b < blocks; ++b)
  {
    const int dimension = in.small();
    in.small(); // entity
    const bool parametric = in.small() != 0;
    const std::int64_t count = in.checked_count(in.large());
    for (std::int64_t i = 0; i < count; ++i)
      raw.node_number.push_back(in.large());
    for (std::int64_t i = 0; i < count; ++i)
    {
      auto& x = raw.x.emplace_back();
      for (double& component : x)
        component = in.real();
      for (int p = 0; parametric && p < dimension; ++p)
        in.real();
    }
  }
}

void read_elements_41(Cursor& in, const Entities& entities, RawMesh& raw)
{
  const std::int64_t blocks = in.checked_count(in.large());
  for (int i = 0; i < 3; ++i) // number of elements, smallest and largest number
    in.large();
  for (std::int64_t b = 0; b < blocks; ++b)
  {
    const int dimension = in.small();
    const int entity = in.small();
    const int gmsh_type = in.small();
    const std::int64_t count = in.checked_count(in.large());
    const auto found = entities.find({dimension, entity});
    // An entity in several groups is listed once in each, as in version 2.2.
    const std::vector<std::int64_t> groups =
        found == entities.end() || found->second.empty() ? std::vector<std::int64_t>{0} : found->second;
    for (std::int64_t i = 0; i < count; ++i)
    {
      const std::int64_t number = in.large();
      const ElementKind kind = kind_of(in, gmsh_type, number);
      RawElement element{.number = number,
                         .type = kind.type,
                         .is_point = kind.is_point,
                         .first_node = raw.element_nodes.size()};
      for (std::size_t a = 0; a < raw_size(element); ++a)
        raw.element_nodes.push_back(in.large());
      for (const std::int64_t group : groups)
      {
        element.group = group;
        raw.elements.push_back(element);
      }
    }
  }
}

RawMesh read_raw(const std::string& path)
{
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  if (file)
    bytes << file.rdbuf();
  if (!file)
    throw InputError(path + ": the mesh file cannot be read", ExitCode::bad_input_file);
  Cursor in(path, bytes.str());
  const double version = read_format(in);
  RawMesh raw;
  Entities entities;
  while (in.open_section())
  {
    if (in.section == "PhysicalNames")
      read_group_names(in, raw);
    else if (in.section == "Entities" && version == 4.1)
      entities = read_entities(in);
    else if (in.section == "Nodes")
      version == 4.1 ? read_nodes_41(in, raw) : read_nodes_22(in, raw);
    else if (in.section == "Elements")
      version == 4.1 ? read_elements_41(in, entities, raw) : read_elements_22(in, raw);
    else if (in.section == "PartitionedEntities")
      in.fail("is a partitioned mesh: write it unpartitioned, Undine distributes it itself");
    else
    {
      in.skip_section();
      continue;
    }
    in.close_section();
  }
  return raw;
}

/// From the file's elements to a checked mesh.
template <int dim>
class Assembly
{
public:
  Assembly(const std::string& path, const RawMesh& raw) : path_(path), raw_(raw) {}

  Mesh<dim> mesh()
  {
    check_dimension();
    number_nodes();
    add_bodies();
    add_surfaces_and_node_sets();
    return std::move(mesh_);
  }

private:
  /// One side of a facet: the element it belongs to and its nodes, outward.
  struct Side
  {
    const RawElement* element;
    std::array<index_t, 4> nodes;
    int n_elements; ///< that share the facet
  };

  [[noreturn]] void fail(const std::string& text) const
  {
    throw InputError(path_ + ": " + text, ExitCode::bad_input_file);
  }
  [[noreturn]] void fail(const RawElement& element, const std::string& text) const
  {
    fail(name_of(raw_, element) + " " + text);
  }

  void check_dimension() const
  {
    bool any = false;
    for (const RawElement& element : raw_.elements)
    {
      any = any || raw_dimension(element) == dim;
      if (raw_dimension(element) > dim)
        fail(element,
             fmt::format("is a {}, but the case is plane (run.dimension = 2)", element_name(element.type)));
    }
    if (!any)
      fail(dim == 2 ? "has no triangles and no quadrilaterals" : "has no tetrahedra and no hexahedra");
  }

  /// Nodes of elements of dimension `dim` keep their order; the others are dropped.
  void number_nodes()
  {
    std::unordered_map<std::int64_t, std::size_t> position;
    for (std::size_t i = 0; i < raw_.node_number.size(); ++i)
      if (!position.emplace(raw_.node_number[i], i).second)
        fail(fmt::format("node {} is listed twice", raw_.node_number[i]));
    std::vector<bool> used(raw_.x.size(), false);
    for (const RawElement& element : raw_.elements)
      for (std::size_t a = 0; a < raw_size(element); ++a)
      {
        const std::int64_t number = raw_.element_nodes[element.first_node + a];
        const auto found = position.find(number);
        if (found == position.end())
          fail(element, fmt::format("names node {}, which the file does not hold", number));
        if (raw_dimension(element) == dim)
          used[found->second] = true;
      }
    for (std::size_t i = 0; i < raw_.x.size(); ++i)
    {
      if (!used[i])
        continue;
      index_of_[raw_.node_number[i]] = mesh_.n_nodes();
      Vec<dim> x;
      for (int d = 0; d < dim; ++d)
        x[d] = raw_.x[i][static_cast<std::size_t>(d)];
      for (const double component : raw_.x[i])
        if (!std::isfinite(component))
          fail(fmt::format("node {} has a coordinate that is no finite number", raw_.node_number[i]));
      mesh_.x.push_back(x);
    }
    if constexpr (dim == 2)
      check_plane(used);
  }

  void check_plane(const std::vector<bool>& used) const
  {
    double extent = 0.0;
    for (const Vec<dim>& x : mesh_.x)
      extent = std::max({extent, std::abs(x[0] - mesh_.x[0][0]), std::abs(x[1] - mesh_.x[0][1])});
    std::optional<double> level;
    for (std::size_t i = 0; i < raw_.x.size(); ++i)
    {
      if (!used[i])
        continue;
      const double z = raw_.x[i][2];
      if (!level)
        level = z;
      if (std::abs(z - *level) > 1e-12 * extent) // round-off of a geometry kernel, no more
        fail(fmt::format("node {} has z = {}, others z = {}: a plane mesh lies at one z", raw_.node_number[i],
                         z, *level));
    }
  }

  index_t node(const RawElement& element, std::size_t a) const
  {
    return index_of_.at(raw_.element_nodes[element.first_node + a]);
  }

  void add_bodies()
  {
    std::map<std::pair<std::string, ElementType>, std::size_t> block_of;
    for (const RawElement& element : raw_.elements)
    {
      if (raw_dimension(element) != dim)
        continue;
      const std::string body = element.group == 0 ? "" : raw_.group_name(dim, element.group);
      const auto [entry, is_new] = block_of.try_emplace({body, element.type}, mesh_.blocks.size());
      if (is_new)
        mesh_.blocks.push_back({.type = element.type, .nodes = {}, .body = body});
      std::vector<index_t> nodes(raw_size(element));
      for (std::size_t a = 0; a < nodes.size(); ++a)
        nodes[a] = node(element, a);
      turn_positive(element, nodes);
      add_sides(element, nodes);
      auto& block_nodes = mesh_.blocks[entry->second].nodes;
      block_nodes.insert(block_nodes.end(), nodes.begin(), nodes.end());
    }
  }

  /// The corners that the edges from corner `a` lead to, in an order that makes a positive Jacobian.
  static std::array<std::size_t, dim> edge_ends(ElementType type, std::size_t a)
  {
    if constexpr (dim == 2)
      return type == ElementType::triangle3 ? std::array<std::size_t, 2>{1, 2}
                                            : std::array<std::size_t, 2>{(a + 1) % 4, (a + 3) % 4};
    else if (type == ElementType::tetrahedron4)
      return {1, 2, 3};
    else if (a < 4) // hexahedron: lower corners look up, upper corners look down
      return {(a + 1) % 4, (a + 3) % 4, a + 4};
    else
      return {4 + (a + 3) % 4, 4 + (a + 1) % 4, a - 4};
  }

  /// Jacobian at corner `a` of the element.
  double corner_jacobian(ElementType type, const std::vector<index_t>& nodes, std::size_t a) const
  {
    const auto position = [&](std::size_t b) { return mesh_.x[static_cast<std::size_t>(nodes[b])]; };
    const auto ends = edge_ends(type, a);
    Mat<dim> edges;
    for (int j = 0; j < dim; ++j)
    {
      const Vec<dim> edge = position(ends[static_cast<std::size_t>(j)]) - position(a);
      for (int i = 0; i < dim; ++i)
        edges(i, j) = edge[i];
    }
    return determinant(edges);
  }

  void turn_positive(const RawElement& element, std::vector<index_t>& nodes) const
  {
    const bool is_simplex = nodes.size() == dim + 1;
    const auto sign = [&]
    {
      int positive = 0, negative = 0;
      const std::size_t corners = is_simplex ? 1 : nodes.size();
      for (std::size_t a = 0; a < corners; ++a)
      {
        const double jacobian = corner_jacobian(element.type, nodes, a);
        positive += jacobian > 0.0;
        negative += jacobian < 0.0;
      }
      return positive == static_cast<int>(corners) ? 1 : negative == static_cast<int>(corners) ? -1 : 0;
    }();
    if (sign == 0)
      fail(element, is_simplex ? fmt::format("is flat: it has no {}", dim == 2 ? "area" : "volume")
                               : "is flat, twisted or not convex");
    if (sign > 0)
      return;
    switch (element.type)
    {
    case ElementType::quadrilateral4:
      std::swap(nodes[1], nodes[3]);
      break;
    case ElementType::hexahedron8:
      std::swap_ranges(nodes.begin(), nodes.begin() + 4, nodes.begin() + 4);
      break;
    default:
      std::swap(nodes[1], nodes[2]);
    }
  }

  void add_sides(const RawElement& element, const std::vector<index_t>& nodes)
  {
    for (const LocalFacet& local : local_facets(element.type))
    {
      Side side{.element = &element, .nodes = {}, .n_elements = 1};
      for (int a = 0; a < local.size; ++a)
        side.nodes[static_cast<std::size_t>(a)] =
            nodes[static_cast<std::size_t>(local.nodes[static_cast<std::size_t>(a)])];
      const FacetKey key = facet_key(std::span(side.nodes).first(static_cast<std::size_t>(local.size)));
      const auto [entry, is_new] = sides_.try_emplace(key, side);
      if (!is_new && ++entry->second.n_elements > 2)
        fail(element,
             fmt::format("shares a side with two others, {} among them: is it listed twice, or in two "
                         "physical groups?",
                         name_of(raw_, *entry->second.element)));
    }
  }

  void add_surfaces_and_node_sets()
  {
    std::map<std::pair<int, std::int64_t>, std::vector<const RawElement*>> groups;
    for (const RawElement& element : raw_.elements)
      if (raw_dimension(element) < dim && element.group != 0)
        groups[{raw_dimension(element), element.group}].push_back(&element);
    for (const auto& [key, members] : groups)
    {
      const auto& [dimension, number] = key;
      const std::string name = raw_.group_name(dimension, number);
      const auto bounds = [this](const RawElement* element) { return find_side(*element) != nullptr; };
      if (dimension == dim - 1 && std::any_of(members.begin(), members.end(), bounds))
        add_surface(name, members);
      else
        add_node_set(name, members);
    }
  }

  const Side* find_side(const RawElement& element) const
  {
    std::array<index_t, 4> nodes{};
    for (std::size_t a = 0; a < raw_size(element); ++a)
    {
      const auto found = index_of_.find(raw_.element_nodes[element.first_node + a]);
      if (found == index_of_.end())
        return nullptr;
      nodes[a] = found->second;
    }
    const auto side = sides_.find(facet_key(std::span(nodes).first(raw_size(element))));
    return side == sides_.end() ? nullptr : &side->second;
  }

  void add_surface(const std::string& name, const std::vector<const RawElement*>& members)
  {
    Surface& surface = mesh_.surfaces[name];
    std::map<const Side*, const RawElement*> seen;
    for (const RawElement* element : members)
    {
      const Side* side = find_side(*element);
      if (side == nullptr)
        fail(*element, "is the side of no element, although others of its group are");
      if (const auto [entry, is_new] = seen.emplace(side, element); !is_new)
        fail(*element, fmt::format("repeats element {}", entry->second->number));
      surface.nodes.insert(surface.nodes.end(), side->nodes.begin(),
                           side->nodes.begin() + static_cast<std::ptrdiff_t>(raw_size(*element)));
      surface.offset.push_back(static_cast<index_t>(surface.nodes.size()));
    }
  }

  void add_node_set(const std::string& name, const std::vector<const RawElement*>& members)
  {
    std::vector<index_t>& set = mesh_.node_sets[name];
    for (const RawElement* element : members)
      for (std::size_t a = 0; a < raw_size(*element); ++a)
      {
        const std::int64_t number = raw_.element_nodes[element->first_node + a];
        const auto found = index_of_.find(number);
        if (found == index_of_.end())
          fail(*element, fmt::format("names node {}, which is a node of no body", number));
        set.push_back(found->second);
      }
    std::sort(set.begin(), set.end());
    set.erase(std::unique(set.begin(), set.end()), set.end());
  }

  const std::string& path_;
  const RawMesh& raw_;
  Mesh<dim> mesh_;
  std::unordered_map<std::int64_t, index_t> index_of_;
  std::map<FacetKey, Side> sides_;
};

} // namespace

template <int dim>
Mesh<dim> read_gmsh(const std::string& path)
{
  const RawMesh raw = read_raw(path);
  return Assembly<dim>(path, raw).mesh();
}

template Mesh<2> read_gmsh(const std::string&);
template Mesh<3> read_gmsh(const std::string&);

} // namespace undine
