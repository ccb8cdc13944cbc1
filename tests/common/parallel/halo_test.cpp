// Ghosts and collectives, run by mpirun on one to eight ranks.
#include "common/error.hpp"
#include "common/parallel/halo.hpp"
#include "common/parallel/mpi_ranks.hpp"
#include "common/tensor.hpp"

#include <catch2/catch.hpp>

#include <array>
#include <chrono>
#include <cmath>
#include <map>
#include <random>

using namespace undine;

namespace
{

Ranks world(double deadline = 60.0) { return ranks_of(MPI_COMM_WORLD, deadline); }

/// A lattice of 6^dim points dealt to ranks at random; each rank holds its own and their lattice neighbours.
template <int dim>
struct Dealt
{
  std::vector<int> name; ///< of each local node: its place in the lattice
  std::vector<char> owned;
  Halo halo;
};

template <int dim>
Dealt<dim> deal(const Ranks& ranks)
{
  constexpr int n = 6;
  int total = 1;
  for (int i = 0; i < dim; ++i)
    total *= n;
  std::mt19937 random(7);
  std::vector<int> owner;
  for (int k = 0; k < total; ++k)
    owner.push_back(static_cast<int>(random() % static_cast<unsigned>(ranks.size())));
  const auto neighbours = [&](int k)
  {
    std::vector<int> near;
    for (int i = 0, stride = 1; i < dim; ++i, stride *= n)
    {
      if (k / stride % n > 0)
        near.push_back(k - stride);
      if (k / stride % n < n - 1)
        near.push_back(k + stride);
    }
    return near;
  };
  const int me = ranks.rank();
  Dealt<dim> d;
  std::map<int, index_t> number;
  for (int k = 0; k < total; ++k)
  {
    bool here = owner[static_cast<std::size_t>(k)] == me;
    for (const int m : neighbours(k))
      here = here || owner[static_cast<std::size_t>(m)] == me;
    if (!here)
      continue;
    number[k] = static_cast<index_t>(d.name.size());
    d.name.push_back(k);
    d.owned.push_back(owner[static_cast<std::size_t>(k)] == me);
  }
  std::vector<std::vector<index_t>> send(static_cast<std::size_t>(ranks.size())), receive = send;
  for (int k = 0; k < total; ++k)
  {
    const int o = owner[static_cast<std::size_t>(k)];
    if (o != me && number.contains(k))
      receive[static_cast<std::size_t>(o)].push_back(number[k]);
    for (int r = 0; r < ranks.size() && o == me; ++r)
      for (const int m : neighbours(k))
        if (r != me && owner[static_cast<std::size_t>(m)] == r)
        {
          send[static_cast<std::size_t>(r)].push_back(number[k]);
          break;
        }
  }
  d.halo = Halo(ranks, send, receive);
  return d;
}

} // namespace

TEMPLATE_TEST_CASE_SIG("ghosts get the values of their owners, also after numbers and needs have changed",
                       "[parallel]", ((int dim), dim), 2, 3)
{
  const Ranks ranks = world();
  Dealt<dim> d = deal<dim>(ranks);
  const auto fill = [&](double t, std::vector<double>& a, std::vector<Vec<dim>>& b)
  {
    a.assign(d.name.size(), -1.0);
    b.assign(d.name.size(), Vec<dim>{});
    for (std::size_t k = 0; k < d.name.size(); ++k)
      if (d.owned[k])
      {
        a[k] = d.name[k] + t;
        b[k][dim - 1] = 1.0 / (d.name[k] + 1.0);
      }
  };
  const auto wrong = [&](double t, const std::vector<double>& a, const std::vector<Vec<dim>>& b)
  {
    std::int64_t count = 0;
    for (std::size_t k = 0; k < d.name.size(); ++k)
      count += a[k] != d.name[k] + t || b[k][dim - 1] != 1.0 / (d.name[k] + 1.0);
    return ranks.sum(count);
  };
  std::vector<double> a;
  std::vector<Vec<dim>> b;
  fill(0.25, a, b);
  d.halo.update(a, b);
  CHECK(wrong(0.25, a, b) == 0);

  // Every third ghost is not needed any more, and numbers turn round.
  std::vector<char> needed(d.name.size(), 1);
  for (std::size_t k = 0; k < needed.size(); ++k)
    needed[k] = d.owned[k] || d.name[k] % 3 != 0;
  d.halo.keep(needed);
  std::vector<index_t> new_number(d.name.size(), -1);
  Dealt<dim> next;
  for (std::size_t k = d.name.size(); k-- > 0;)
    if (needed[k])
    {
      new_number[k] = static_cast<index_t>(next.name.size());
      next.name.push_back(d.name[k]);
      next.owned.push_back(d.owned[k]);
    }
  d.halo.renumber(new_number);
  d.name = next.name;
  d.owned = next.owned;
  fill(0.5, a, b);
  d.halo.start(a, b);
  d.halo.finish(a, b);
  CHECK(wrong(0.5, a, b) == 0);
}

TEST_CASE("reductions and gathers see all ranks, exact sums no order", "[parallel]")
{
  const Ranks ranks = world();
  CHECK(ranks.max(static_cast<double>(ranks.rank())) == ranks.size() - 1);
  CHECK(ranks.any(ranks.rank() == ranks.size() - 1));
  CHECK_FALSE(ranks.any(false));
  CHECK(ranks.sum(std::int64_t{1}) == ranks.size());

  ExactSum all, mine;
  for (int k = 0; k < 1000; ++k)
  {
    const double term = std::sin(k) * std::pow(10.0, k % 31 - 15);
    all.add(term);
    if (k % ranks.size() == ranks.rank())
      mine.add(term);
  }
  ranks.sum({&mine});
  CHECK(mine.value() == all.value());

  std::vector<std::size_t> counts;
  const std::vector<int> items(static_cast<std::size_t>(ranks.rank() % 3), ranks.rank());
  const std::vector<int> gathered = ranks.gather(items, &counts);
  std::vector<int> truth;
  for (int r = 0; r < ranks.size(); ++r)
    truth.insert(truth.end(), static_cast<std::size_t>(r % 3), r);
  CHECK(gathered == truth);
  CHECK(counts.size() == static_cast<std::size_t>(ranks.size()));

  std::vector<std::vector<int>> to(static_cast<std::size_t>(ranks.size()));
  for (int r = 0; r < ranks.size(); ++r)
    to[static_cast<std::size_t>(r)].assign(static_cast<std::size_t>((ranks.rank() + r) % 2),
                                           100 * ranks.rank() + r);
  const auto from = ranks.exchange(to);
  for (int r = 0; r < ranks.size(); ++r)
    CHECK(from[static_cast<std::size_t>(r)] ==
          std::vector<int>(static_cast<std::size_t>((ranks.rank() + r) % 2), 100 * r + ranks.rank()));
}

TEST_CASE("a rank that waits too long says for whom, and may wait on", "[parallel]")
{
  const Ranks patient = world(), hasty = world(0.2);
  if (patient.size() < 2)
    return;
  std::byte box{};
  const std::array<Ranks::Part, 1> from_first{{{0, &box, 1}}}, to_second{{{1, &box, 1}}};
  if (patient.rank() == 1)
  {
    const auto message = hasty.start({}, from_first);
    CHECK_THROWS_WITH(hasty.wait(*message), Catch::Contains("rank 0 of this program kept another waiting"));
    patient.any(true);
    patient.wait(*message);
    CHECK(box == std::byte{7});
    return;
  }
  patient.any(true); // comes back when the second rank has lost its patience
  if (patient.rank() == 0)
  {
    box = std::byte{7};
    patient.wait(*patient.start(to_second, {}));
  }
}
