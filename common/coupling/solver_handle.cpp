// Ranks of a solver that speak as one: what rank 0 tells, the parts that it joins, the order of rows.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/solver_handle.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/undine_link.h"
#include "common/coupling/wire.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <utility>

namespace undine::link
{
namespace
{

/// What rank 0 gets by `receive`, on all ranks; so is its failure.
template <class Receive, class Write, class Read>
auto told(undine_link& link, Receive&& receive, Write&& write, Read&& read) -> decltype(receive())
{
  if (!link.team)
    return receive();
  std::vector<std::byte> bytes;
  wire::Writer out(bytes);
  if (link.team->rank() == 0)
  {
    std::optional<decltype(receive())> content;
    try
    {
      content = receive();
    }
    catch (const ProtocolError& error)
    {
      out.i32(error.code());
      out.string(error.what());
      link.team->tell(std::move(bytes));
      throw;
    }
    out.i32(UNDINE_OK);
    write(out, *content);
    link.team->tell(std::move(bytes));
    return *content;
  }
  bytes = link.team->tell({});
  wire::Reader in(bytes, "the word of rank 0");
  if (const int code = in.i32("code"); code != UNDINE_OK)
    throw ProtocolError(code, in.string("text"));
  return read(in);
}

const auto write_content = [](wire::Writer& out, const auto& content) { wire::write(out, content); };

/// What the ranks have given, whoever gave it: nodes by number, faces by interface and the numbers of their
/// nodes.
struct Parts
{
  struct Node
  {
    std::int32_t owner;
    std::vector<double> x, inverse_mass;
  };
  std::map<std::int64_t, Node> nodes;
  std::vector<std::pair<std::int32_t, std::vector<std::int64_t>>> faces;
};

Parts parts_of(const std::vector<std::vector<std::byte>>& ranks, std::size_t dim)
{
  Parts all;
  for (std::size_t rank = 0; rank < ranks.size(); ++rank)
  {
    wire::Reader in(ranks[rank], "the surface of rank " + std::to_string(rank));
    const auto id = in.i64_list("node_id");
    const auto x = in.f64_list("x"), W = in.f64_list("inverse_mass");
    const auto offset = in.i32_list("face_offset"), interface = in.i32_list("face_interface");
    const auto face_ids = in.i64_list("face_nodes");
    for (std::size_t k = 0; k < id.size(); ++k)
    {
      const auto rows = [k](const std::vector<double>& values, std::size_t width)
      {
        return std::vector<double>(values.begin() + static_cast<std::ptrdiff_t>(k * width),
                                   values.begin() + static_cast<std::ptrdiff_t>((k + 1) * width));
      };
      const auto [place, is_new] = all.nodes.try_emplace(
          id[k], Parts::Node{static_cast<std::int32_t>(rank), rows(x, dim), rows(W, dim * dim)});
      require(is_new, "undine_send_surface: node " + std::to_string(id[k]) + " was given by rank " +
                          std::to_string(place->second.owner) + " and by rank " + std::to_string(rank) +
                          "; each node belongs to one rank");
    }
    for (std::size_t f = 0; f + 1 < offset.size(); ++f)
      all.faces.emplace_back(interface[f], std::vector<std::int64_t>(face_ids.begin() + offset[f],
                                                                     face_ids.begin() + offset[f + 1]));
  }
  std::sort(all.faces.begin(), all.faces.end());
  return all;
}

/// Parts of all ranks as one surface.
SurfaceMesh joined(const undine_link& link, const Parts& parts)
{
  SurfaceMesh all;
  all.dim = link.surface.dim;
  all.epoch = link.surface.epoch;
  all.interfaces = link.surface.interfaces;
  std::map<std::int64_t, std::int32_t> position;
  for (const auto& [id, node] : parts.nodes)
  {
    position.emplace(id, static_cast<std::int32_t>(all.node_id.size()));
    all.node_id.push_back(id);
    all.x.insert(all.x.end(), node.x.begin(), node.x.end());
    all.inverse_mass.insert(all.inverse_mass.end(), node.inverse_mass.begin(), node.inverse_mass.end());
    all.owner.push_back(node.owner);
  }
  for (const auto& [interface, ids] : parts.faces)
  {
    for (const std::int64_t id : ids)
    {
      const auto found = position.find(id);
      require(found != position.end(), "undine_send_surface: a face has node " + std::to_string(id) +
                                           ", which no rank has given by undine_set_nodes");
      all.face_nodes.push_back(found->second);
    }
    all.face_offset.push_back(static_cast<std::int32_t>(all.face_nodes.size()));
    all.face_interface.push_back(interface);
  }
  if (std::all_of(all.owner.begin(), all.owner.end(), [](std::int32_t r) { return r == 0; }))
    all.owner.clear();
  return all;
}

/// The nodes and faces of this rank, for parts_of().
std::vector<std::byte> own_part(const undine_link& link)
{
  std::vector<std::byte> bytes;
  wire::Writer out(bytes);
  out.list<std::int64_t>(link.surface.node_id);
  out.list<double>(link.surface.x);
  out.list<double>(link.surface.inverse_mass);
  out.list<std::int32_t>(link.surface.face_offset);
  out.list<std::int32_t>(link.surface.face_interface);
  out.list<std::int64_t>(link.face_ids);
  return bytes;
}

} // namespace

void require(bool holds, const std::string& text)
{
  if (!holds)
    throw ProtocolError(code::internal_error, text);
}

bool is_first(const undine_link& link) { return !link.team || link.team->rank() == 0; }

Setup receive_setup(undine_link& link)
{
  const Setup setup = told(
      link, [&link] { return link.conversation->receive_setup(); }, write_content, wire::read_setup);
  if (!is_first(link))
    link.conversation->hear(setup);
  return setup;
}

SurfaceMesh receive_surface(undine_link& link)
{
  SurfaceMesh surface = told(
      link, [&link] { return link.conversation->receive_surface(); }, write_content, wire::read_surface_mesh);
  if (!is_first(link))
    link.conversation->hear(surface);
  return surface;
}

SolverLink::Order next_order(undine_link& link)
{
  SolverLink& talk = *link.conversation;
  enum : std::uint8_t
  {
    end,
    window,
    checkpoint
  };
  const auto order = told(
      link,
      [&]
      {
        auto next = talk.next_order();
        while (!link.offers_checkpoints && std::holds_alternative<CheckpointOrder>(next))
        {
          talk.send_checkpoint_done({.reason = "this solver writes no checkpoints"});
          next = talk.next_order();
        }
        return next;
      },
      [](wire::Writer& out, const SolverLink::Order& next)
      {
        out.u8(static_cast<std::uint8_t>(next.index())); // the order of the variant's types is that above
        if (const auto* w = std::get_if<Window>(&next))
          wire::write(out, *w);
        if (const auto* c = std::get_if<CheckpointOrder>(&next))
          wire::write(out, *c);
      },
      [](wire::Reader in) -> SolverLink::Order
      {
        const std::uint8_t kind = in.u8("kind");
        if (kind == window)
          return wire::read_window(in);
        if (kind == checkpoint)
          return wire::read_checkpoint_order(in);
        return {};
      });
  if (is_first(link))
    return order;
  if (const auto* next = std::get_if<Window>(&order))
    talk.hear(*next);
  else if (std::holds_alternative<std::monostate>(order))
    talk.hear_end();
  return order;
}

void begin_surface(undine_link& link, std::int64_t n, const std::int64_t* node_id, const double* x)
{
  require(link.has_setup, "the surface comes after undine_receive_setup");
  require(n >= 0 && n <= std::numeric_limits<std::int32_t>::max(), "n = " + std::to_string(n) + " wet nodes");
  require(x != nullptr || n == 0, "x is NULL");
  const auto count = static_cast<std::size_t>(n);
  const auto dim = static_cast<std::size_t>(link.setup.dim);
  SurfaceMesh surface;
  surface.dim = link.setup.dim;
  surface.epoch = link.surface_was_sent ? link.surface.epoch + 1 : 0;
  surface.interfaces = link.setup.interfaces;
  surface.node_id.resize(count);
  for (std::size_t k = 0; k < count; ++k)
    surface.node_id[k] = node_id != nullptr ? node_id[k] : static_cast<std::int64_t>(k);
  surface.x.assign(x, x + count * dim);
  surface.inverse_mass.assign(count * dim * dim, 0.0);
  link.surface = std::move(surface);
  link.face_ids.clear();
  if (!link.team)
    return;
  require(node_id != nullptr || n == 0, "node_id is NULL: after undine_distribute nodes have global numbers");
  link.place.resize(count);
  for (std::size_t k = 0; k < count; ++k)
    link.place[k] = k;
  std::sort(link.place.begin(), link.place.end(),
            [node_id](std::size_t a, std::size_t b) { return node_id[a] < node_id[b]; });
}

void append_faces(undine_link& link, std::int32_t interface, std::int64_t n_faces,
                  std::int32_t nodes_per_face)
{
  for (std::int64_t f = 0; f < n_faces; ++f)
  {
    link.surface.face_offset.push_back(link.surface.face_offset.back() + nodes_per_face);
    link.surface.face_interface.push_back(interface);
  }
}

void send_surface(undine_link& link)
{
  const auto send = [&link](const SurfaceMesh& surface)
  {
    if (link.surface_was_sent)
      link.conversation->send_mesh_update(surface);
    else
      link.conversation->send_mesh(surface);
  };
  if (link.team)
  {
    const auto ranks = link.team->collect(own_part(link));
    told(
        link,
        [&]
        {
          send(joined(link, parts_of(ranks, static_cast<std::size_t>(link.setup.dim))));
          return true;
        },
        [](wire::Writer&, bool) {}, [](const wire::Reader&) { return true; });
  }
  else
    send(link.surface);
  if (!is_first(link))
  {
    SurfaceMesh rows; // as much of it as the exchange of this rank's rows depends on
    rows.dim = link.surface.dim;
    rows.epoch = link.surface.epoch;
    rows.node_id = link.surface.node_id;
    rows.owner.assign(rows.node_id.size(), static_cast<std::int32_t>(link.team->rank()));
    send(rows);
  }
  link.surface_was_sent = true;
}

std::span<const double> in_link_order(const undine_link& link, const double* values, const char* name,
                                      std::vector<double>& room)
{
  const auto given = vector(link, values, name);
  if (!link.team)
    return given;
  const auto dim = static_cast<std::size_t>(link.surface.dim);
  room.resize(given.size());
  for (std::size_t k = 0; k < link.place.size(); ++k)
    std::copy_n(given.begin() + static_cast<std::ptrdiff_t>(link.place[k] * dim), dim,
                room.begin() + static_cast<std::ptrdiff_t>(k * dim));
  return room;
}

void in_given_order(const undine_link& link, std::span<const double> rows, std::span<double> values)
{
  const auto dim = static_cast<std::size_t>(link.surface.dim);
  for (std::size_t k = 0; k < values.size() / dim; ++k)
    std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(k * dim), dim,
                values.begin() + static_cast<std::ptrdiff_t>((link.team ? link.place[k] : k) * dim));
}

} // namespace undine::link
