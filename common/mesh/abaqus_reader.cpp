// Reader of Abaqus input files (.inp): the mesh, its sets and surfaces; everything else is passed over.
#include "common/error.hpp"
#include "common/mesh/facets.hpp"
#include "common/mesh/mesh.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>
#include <utility>

namespace undine
{

namespace
{

std::string upper(std::string text)
{
  for (auto& c : text)
    c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

std::string trimmed(const std::string& text)
{
  const auto first = text.find_first_not_of(" \t\r");
  const auto last = text.find_last_not_of(" \t\r");
  return first == std::string::npos ? "" : text.substr(first, last - first + 1);
}

std::vector<std::string> split(const std::string& line)
{
  std::vector<std::string> words;
  std::stringstream stream(line);
  for (std::string word; std::getline(stream, word, ',');)
    words.push_back(trimmed(word));
  return words;
}

/// Our type of an Abaqus element: its shape is in the letters and the number of nodes.
std::optional<ElementType> element_type(const std::string& type)
{
  const auto is = [&type](const char* start) { return type.rfind(start, 0) == 0; };
  if (is("CPS3") || is("CPE3") || is("CAX3") || is("M3D3") || is("S3"))
    return ElementType::triangle3;
  if (is("CPS4") || is("CPE4") || is("CAX4") || is("M3D4") || is("S4"))
    return ElementType::quadrilateral4;
  if (type == "C3D4" || type == "C3D4H")
    return ElementType::tetrahedron4;
  if (type == "C3D8" || type == "C3D8R" || type == "C3D8I" || type == "C3D8H" || type == "C3D8RH")
    return ElementType::hexahedron8;
  if (type == "B21" || type == "T2D2" || type == "B31" || type == "T3D2")
    return ElementType::line2;
  return std::nullopt;
}

/// Nodes of face S1, S2, ... of an Abaqus element, as positions in its list of nodes.
std::vector<std::vector<int>> faces_of(ElementType type)
{
  switch (type)
  {
  case ElementType::triangle3:
    return {{0, 1}, {1, 2}, {2, 0}};
  case ElementType::quadrilateral4:
    return {{0, 1}, {1, 2}, {2, 3}, {3, 0}};
  case ElementType::tetrahedron4:
    return {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
  case ElementType::hexahedron8:
    return {{0, 1, 2, 3}, {4, 7, 6, 5}, {0, 4, 5, 1}, {1, 5, 6, 2}, {2, 6, 7, 3}, {3, 7, 4, 0}};
  default:
    return {};
  }
}

template <int dim>
class AbaqusReader
{
public:
  explicit AbaqusReader(const std::string& path) : path_(path), stream_(path)
  {
    if (!stream_)
      throw InputError(path + ": cannot be read", ExitCode::bad_input_file);
  }

  Mesh<dim> read()
  {
    next_line();
    while (!at_end_)
    {
      if (line_[0] != '*')
        fail("data without a keyword before it");
      const auto words = split(line_.substr(1));
      if (words.empty())
        fail("a keyword is missing behind *");
      const auto keyword = upper(words[0]);
      parameters_.clear();
      for (std::size_t k = 1; k < words.size(); ++k)
      {
        const auto equals = words[k].find('=');
        parameters_[upper(trimmed(words[k].substr(0, equals)))] =
            equals == std::string::npos ? "" : trimmed(words[k].substr(equals + 1));
      }
      next_line();
      if (keyword == "NODE")
        read_nodes();
      else if (keyword == "ELEMENT")
        read_elements();
      else if (keyword == "NSET")
        read_set("NSET", node_sets_, mesh_names_);
      else if (keyword == "ELSET")
        read_set("ELSET", element_sets_, mesh_names_);
      else if (keyword == "SURFACE")
        read_surface();
      else if (keyword == "INCLUDE")
        fail("*INCLUDE is not followed: put everything into one file");
      else if (keyword == "INSTANCE" && ++instances_ > 1)
        fail("several *INSTANCE: write the assembly as one flat input (orphan mesh)");
      else
        while (!at_end_ && line_[0] != '*')
          next_line();
    }
    return assemble();
  }

private:
  [[noreturn]] void fail(const std::string& text) const
  {
    throw InputError(path_ + ":" + std::to_string(line_number_) + ": " + text, ExitCode::bad_input_file);
  }

  /// The next line that is neither empty nor a comment.
  void next_line()
  {
    std::string line;
    while (std::getline(stream_, line))
    {
      ++line_number_;
      line_ = trimmed(line);
      if (!line_.empty() && line_.rfind("**", 0) != 0)
        return;
    }
    at_end_ = true;
  }
  bool on_data() const { return !at_end_ && line_[0] != '*'; }

  double number(const std::string& word) const
  {
    std::size_t used = 0;
    double value = 0.0;
    try
    {
      value = std::stod(word, &used);
    }
    catch (const std::exception&)
    {
      used = 0;
    }
    if (used == 0 || used != word.size() || !std::isfinite(value))
      fail("\"" + word + "\" is no number");
    return value;
  }
  /// Number of a node or element; Abaqus has nine digits for it.
  long label(const std::string& word) const
  {
    const double value = number(word);
    if (!(value >= 1.0 && value <= 999999999.0 && value == std::floor(value)))
      fail("\"" + word + "\" is no whole number from 1 to 999999999");
    return static_cast<long>(value);
  }
  /// A set grows by `members`; one larger than any mesh that fits here is a mistake.
  void require_room(const std::vector<long>& set, std::size_t members) const
  {
    constexpr std::size_t most = 50'000'000;
    if (members > most || set.size() > most - members)
      fail("the set has more than " + std::to_string(most) + " members");
  }

  void read_nodes()
  {
    const auto set = parameters_.find("NSET");
    for (; on_data(); next_line())
    {
      const auto words = split(line_);
      if (words.size() < static_cast<std::size_t>(dim) + 1)
        fail("a node needs its number and " + std::to_string(dim) + " coordinates");
      Vec<dim> x;
      for (int i = 0; i < dim; ++i)
        x[i] = number(words[static_cast<std::size_t>(i) + 1]);
      const long id = label(words[0]);
      if (!node_of_.emplace(id, static_cast<index_t>(x_.size())).second)
        fail("node " + words[0] + " is there twice");
      x_.push_back(x);
      if (set != parameters_.end())
        add_name(set->second, node_sets_).push_back(id);
    }
  }

  struct Element
  {
    ElementType type;
    std::vector<long> nodes;
    std::string body;
    std::size_t block, position;
  };

  void read_elements()
  {
    const auto type = element_type(upper(parameters_["TYPE"]));
    if (!type)
      fail("*ELEMENT, TYPE=" + parameters_["TYPE"] +
           ": known are CPS3 CPE3 CAX3 CPS4 CPE4 CAX4 C3D4 C3D8 and their variants, B21 T2D2");
    const auto set = parameters_.count("ELSET") > 0 ? parameters_["ELSET"] : "";
    const auto n = static_cast<std::size_t>(nodes_per_element(*type));
    while (on_data())
    {
      std::vector<long> row; // an element may go over several lines
      while (on_data() && row.size() < n + 1)
      {
        for (const auto& word : split(line_))
          if (!word.empty())
            row.push_back(label(word));
        next_line();
      }
      if (row.size() != n + 1)
        fail("an element of this type has " + std::to_string(n) + " nodes");
      Element element{
          .type = *type, .nodes = {row.begin() + 1, row.end()}, .body = set, .block = 0, .position = 0};
      if (!elements_.emplace(row[0], std::move(element)).second)
        fail("element " + std::to_string(row[0]) + " is there twice");
      if (!set.empty())
        add_name(set, element_sets_).push_back(row[0]);
    }
  }

  using Sets = std::map<std::string, std::vector<long>>; ///< by name in capitals

  std::vector<long>& add_name(const std::string& name, Sets& sets)
  {
    mesh_names_.emplace(upper(name), name);
    return sets[upper(name)];
  }

  void read_set(const char* key, Sets& sets, std::map<std::string, std::string>&)
  {
    if (parameters_[key].empty())
      fail(std::string("*") + key + " needs a name: " + key + "=...");
    auto& set = add_name(parameters_[key], sets);
    const bool generate = parameters_.count("GENERATE") > 0;
    for (; on_data(); next_line())
    {
      const auto words = split(line_);
      if (generate)
      {
        if (words.size() < 2)
          fail("GENERATE needs first, last and step");
        const long step = words.size() > 2 && !words[2].empty() ? label(words[2]) : 1;
        const long first = label(words[0]), last = label(words[1]);
        require_room(set, last < first ? 0 : static_cast<std::size_t>((last - first) / step) + 1);
        for (long k = first; k <= last; k += step)
          set.push_back(k);
        continue;
      }
      for (const auto& word : words)
      {
        if (word.empty())
          continue;
        if (const auto other = sets.find(upper(word)); other != sets.end())
        {
          const auto members = other->second; // the set may name itself
          require_room(set, members.size());
          set.insert(set.end(), members.begin(), members.end());
        }
        else
          set.push_back(label(word));
      }
    }
  }

  void read_surface()
  {
    const auto type = upper(parameters_["TYPE"]);
    if (!type.empty() && type != "ELEMENT")
    {
      while (on_data()) // a surface of nodes: the node set it is made of serves as well
        next_line();
      return;
    }
    const auto name = parameters_["NAME"];
    if (name.empty())
      fail("*SURFACE needs NAME=...");
    for (; on_data(); next_line())
    {
      const auto words = split(line_);
      if (words.size() < 2 || upper(words[1])[0] != 'S')
        fail("a surface line must be: element or set, S<face>");
      const auto face = static_cast<std::size_t>(label(words[1].substr(1))) - 1;
      const auto set = element_sets_.find(upper(words[0]));
      const auto members = set != element_sets_.end() ? set->second : std::vector<long>{label(words[0])};
      for (const long id : members)
        faces_[name].push_back({id, face});
    }
  }

  Mesh<dim> assemble()
  {
    Mesh<dim> mesh;
    mesh.x = std::move(x_);
    std::map<std::pair<std::string, ElementType>, std::size_t> block_of;
    for (auto& [id, element] : elements_)
    {
      const auto [at, is_new] = block_of.emplace(std::pair{element.body, element.type}, mesh.blocks.size());
      if (is_new)
        mesh.blocks.push_back({.type = element.type, .nodes = {}, .body = element.body});
      for (const long node : element.nodes)
        mesh.blocks[at->second].nodes.push_back(index_of(node, "element " + std::to_string(id)));
    }
    bool has_bulk = false;
    for (const auto& block : mesh.blocks)
      has_bulk = has_bulk || element_dimension(block.type) == dim;
    if (!has_bulk)
      throw InputError(path_ + ": no element of dimension " + std::to_string(dim), ExitCode::bad_input_file);

    for (const auto& [name, members] : node_sets_)
    {
      auto& set = mesh.node_sets[mesh_names_.at(name)];
      for (const long node : members)
        set.push_back(index_of(node, "node set " + name));
      std::sort(set.begin(), set.end());
      set.erase(std::unique(set.begin(), set.end()), set.end());
    }
    for (const auto& [name, faces] : faces_)
      for (const auto& [id, face] : faces)
        add_facet(mesh, mesh.surfaces[name], name, id, face);
    return mesh;
  }

  index_t index_of(long node, const std::string& who) const
  {
    const auto found = node_of_.find(node);
    if (found == node_of_.end())
      throw InputError(path_ + ": " + who + ": there is no node " + std::to_string(node),
                       ExitCode::bad_input_file);
    return found->second;
  }

  /// One face, turned so that its normal points away from the middle of the element.
  void add_facet(const Mesh<dim>& mesh, Surface& surface, const std::string& name, long id,
                 std::size_t face) const
  {
    const auto element = elements_.find(id);
    if (element == elements_.end())
      throw InputError(path_ + ": surface " + name + ": there is no element " + std::to_string(id),
                       ExitCode::bad_input_file);
    const auto faces = faces_of(element->second.type);
    if (face >= faces.size() || element_dimension(element->second.type) != dim)
      throw InputError(path_ + ": surface " + name + ": element " + std::to_string(id) + " has no face S" +
                           std::to_string(face + 1),
                       ExitCode::bad_input_file);
    std::vector<index_t> nodes;
    for (const int a : faces[face])
      nodes.push_back(index_of(element->second.nodes[static_cast<std::size_t>(a)], name));
    const auto x = [&](std::size_t a) { return mesh.x[static_cast<std::size_t>(nodes[a])]; };
    Vec<dim> middle, normal;
    for (const long node : element->second.nodes)
      middle += (1.0 / static_cast<double>(element->second.nodes.size())) *
                mesh.x[static_cast<std::size_t>(index_of(node, name))];
    if constexpr (dim == 2)
      normal = right_normal(x(1) - x(0));
    else
      normal = cross(x(1) - x(0), x(2) - x(0));
    if (dot(normal, x(0) - middle) < 0.0)
      std::reverse(nodes.begin(), nodes.end());
    surface.nodes.insert(surface.nodes.end(), nodes.begin(), nodes.end());
    surface.offset.push_back(static_cast<index_t>(surface.nodes.size()));
  }

  std::string path_;
  std::ifstream stream_;
  std::string line_;
  int line_number_ = 0, instances_ = 0;
  bool at_end_ = false;
  std::map<std::string, std::string> parameters_;
  std::vector<Vec<dim>> x_;
  std::map<long, index_t> node_of_;
  std::map<long, Element> elements_;
  Sets node_sets_, element_sets_;
  std::map<std::string, std::string> mesh_names_; ///< as the file spells them, by capitals
  std::map<std::string, std::vector<std::pair<long, std::size_t>>> faces_;
};

} // namespace

template <int dim>
Mesh<dim> read_abaqus(const std::string& path)
{
  return AbaqusReader<dim>(path).read();
}

template Mesh<2> read_abaqus<2>(const std::string&);
template Mesh<3> read_abaqus<3>(const std::string&);

} // namespace undine
