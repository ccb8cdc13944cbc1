// What rank 0 hears, told to the other ranks and their links.
#include "common/program/shared_link.hpp"

#include <utility>

namespace undine
{

namespace
{

/// What the others must do next.
struct Order
{
  enum Kind
  {
    window,
    checkpoint,
    end
  } kind = end;
  link::Window of_window{};
};

std::string told(const Ranks& ranks, const std::string& text)
{
  const std::vector<char> all = ranks.of_first(std::vector<char>(text.begin(), text.end()));
  return {all.begin(), all.end()};
}

} // namespace

link::Setup SharedLink::receive_setup()
{
  link::Setup setup = is_first() ? link_->receive_setup() : link::Setup{};
  if (ranks_.alone())
    return setup;
  setup.dim = ranks_.of_first(std::vector{setup.dim}).front();
  setup.t_begin = ranks_.of_first(std::vector{setup.t_begin}).front();
  setup.t_end = ranks_.of_first(std::vector{setup.t_end}).front();
  setup.scheme = told(ranks_, setup.scheme);
  setup.restart = told(ranks_, setup.restart);
  if (link_ && !is_first())
    link_->hear(setup);
  return setup;
}

link::SurfaceMesh SharedLink::receive_surface()
{
  link::SurfaceMesh surface = is_first() ? link_->receive_surface() : link::SurfaceMesh{};
  if (ranks_.alone())
    return surface;
  surface.dim = ranks_.of_first(std::vector{surface.dim}).front();
  surface.epoch = ranks_.of_first(std::vector{surface.epoch}).front();
  const auto tell = [this](auto&... fields) { ((fields = ranks_.of_first(fields)), ...); };
  tell(surface.node_id, surface.x, surface.inverse_mass, surface.face_offset, surface.face_nodes,
       surface.face_interface, surface.coupled_nodes, surface.coupled_inverse_mass);
  if (link_ && !is_first())
    link_->hear(surface);
  return surface;
}

std::optional<link::Window> SharedLink::next_window()
{
  if (ranks_.alone())
    return link_->next_window();
  if (is_first())
  {
    const auto window = link_->next_window(); // obeys orders for checkpoints meanwhile
    ranks_.of_first(
        std::vector<Order>{{window ? Order::window : Order::end, window.value_or(link::Window{})}});
    return window;
  }
  for (;;)
  {
    const Order order = ranks_.of_first(std::vector<Order>{}).front();
    if (order.kind == Order::checkpoint)
      write_({});
    else if (order.kind == Order::window)
    {
      if (link_)
        link_->hear(order.of_window);
      return order.of_window;
    }
    else
    {
      if (link_)
        link_->hear_end();
      return std::nullopt;
    }
  }
}

void SharedLink::on_checkpoint(std::function<link::CheckpointDone(const link::CheckpointOrder&)> write)
{
  write_ = std::move(write);
  if (is_first())
    link_->on_checkpoint(
        [ranks = ranks_, write = write_](const link::CheckpointOrder& order)
        {
          if (!ranks.alone())
            ranks.of_first(std::vector<Order>{{Order::checkpoint, {}}});
          return write(order);
        });
}

link::Activation SharedLink::receive_activation()
{
  return link_ ? link_->receive_activation() : link::Activation{};
}

void SharedLink::receive_link_force(std::span<double> f_link)
{
  if (link_)
    link_->receive_link_force(f_link);
}

void SharedLink::send_mesh(const link::SurfaceMesh& mesh)
{
  if (link_)
    link_->send_mesh(mesh);
}

void SharedLink::send_mesh_update(const link::SurfaceMesh& mesh)
{
  if (link_)
    link_->send_mesh_update(mesh);
}

void SharedLink::send_report(const link::Report& report)
{
  if (link_)
    link_->send_report(report);
}

void SharedLink::send_kinematics(const link::Kinematics& kinematics)
{
  if (link_)
    link_->send_kinematics(kinematics);
}

void SharedLink::send_free_velocity(std::span<const double> v_free)
{
  if (link_)
    link_->send_free_velocity(v_free);
}

void SharedLink::send_stop_request(const std::string& reason)
{
  if (is_first())
    link_->send_stop_request(reason);
}

} // namespace undine
