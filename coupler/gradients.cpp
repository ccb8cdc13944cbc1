// Rows of H in stretches, and the iteration over them.
#include "coupler/gradients.hpp"

#include "common/error.hpp"
#include "coupler/helpers.hpp"
#include "coupler/interface_operator.hpp"

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>

namespace undine::coupler
{

namespace
{

constexpr std::size_t block = 256; ///< rows whose products are added first

/// The rows that are wanted.
void write(link::wire::Writer& out, const Rows& A, const std::vector<char>& wanted)
{
  std::vector<std::int32_t> row, entries, column;
  std::vector<double> value;
  for (Eigen::Index k = 0; k < A.rows(); ++k)
    if (wanted[static_cast<std::size_t>(k)] != 0)
    {
      row.push_back(static_cast<std::int32_t>(k));
      for (Rows::InnerIterator it(A, k); it; ++it)
      {
        column.push_back(static_cast<std::int32_t>(it.col()));
        value.push_back(it.value());
      }
      entries.push_back(static_cast<std::int32_t>(column.size()));
    }
  out.i64(A.rows());
  out.i64(A.cols());
  out.list<std::int32_t>(row);
  out.list<std::int32_t>(entries);
  out.list<std::int32_t>(column);
  out.list<double>(value);
}

/// The matrix with these rows; others are empty.
Rows read_rows(link::wire::Reader& in)
{
  const auto rows = in.i64("rows"), columns = in.i64("columns");
  const auto row = in.i32_list("row"), entries = in.i32_list("entries"), column = in.i32_list("column");
  const auto value = in.f64_list("value");
  std::vector<std::int32_t> starts(static_cast<std::size_t>(rows) + 1, 0);
  std::size_t next = 0;
  for (std::size_t k = 0; k < row.size(); ++k)
  {
    const auto r = static_cast<std::size_t>(row[k]);
    for (; next <= r; ++next)
      starts[next] = k == 0 ? 0 : entries[k - 1];
  }
  for (; next < starts.size(); ++next)
    starts[next] = entries.empty() ? 0 : entries.back();
  return Eigen::Map<const Rows>(rows, columns, static_cast<Eigen::Index>(value.size()), starts.data(),
                                column.data(), value.data());
}

/// What the rank with the multipliers from begin to before end needs of a side: their rows of L, those of M⁻¹
/// of the velocities that they ask for, and the rows of L that make these velocities.
void write_needed(link::wire::Writer& out, const Rows& L, const SparseMatrix& L_by_columns,
                  const Rows& inverse_mass, Eigen::Index begin, Eigen::Index end)
{
  std::vector<char> rows(static_cast<std::size_t>(L.rows()), 0), asked(static_cast<std::size_t>(L.cols()), 0);
  for (Eigen::Index row = begin; row < end; ++row)
    for (Rows::InnerIterator it(L, row); it; ++it)
      asked[static_cast<std::size_t>(it.col())] = 1;
  for (Eigen::Index v = 0; v < L.cols(); ++v)
    if (asked[static_cast<std::size_t>(v)] != 0)
      for (Rows::InnerIterator moved(inverse_mass, v); moved; ++moved)
        for (SparseMatrix::InnerIterator it(L_by_columns, moved.col()); it; ++it)
          rows[static_cast<std::size_t>(it.row())] = 1;
  std::fill(rows.begin() + begin, rows.begin() + end, 1);
  write(out, L, rows);
  write(out, inverse_mass, asked);
}

std::span<const double> stretch(std::span<const double> all, const std::array<std::size_t, 2>& part)
{
  return part[0] < part[1] ? all.subspan(part[0], part[1] - part[0]) : std::span<const double>();
}

/// n numbers, zero but for the stretch.
Vector read_stretch(link::wire::Reader& in, const char* name, Eigen::Index n,
                    const std::array<std::size_t, 2>& part)
{
  Vector all = Vector::Zero(n);
  const auto values = in.f64_list(name);
  require(values.size() == stretch(as_span(all), part).size(), "both ranks know the stretch");
  std::copy(values.begin(), values.end(), all.data() + part[0]);
  return all;
}

/// use(row, product of the row with x). Four sums: one would wait for each addition.
void for_each_row(const Rows& A, const Vector& x, const auto& use)
{
  const double *const value = A.valuePtr(), *const of = x.data();
  const int* const column = A.innerIndexPtr();
  for (Eigen::Index row = 0; row < A.rows(); ++row)
  {
    std::array<double, 4> sum{};
    int k = A.outerIndexPtr()[row];
    const int end = A.outerIndexPtr()[row + 1];
    for (; k + 4 <= end; k += 4)
      for (int i = 0; i < 4; ++i)
        sum[static_cast<std::size_t>(i)] += value[k + i] * of[column[k + i]];
    for (; k < end; ++k)
      sum[0] += value[k] * of[column[k]];
    use(row, (sum[0] + sum[1]) + (sum[2] + sum[3]));
  }
}

} // namespace

Gradients::Part Gradients::part_of(const InterfaceSide& side, Eigen::Index begin, Eigen::Index end)
{
  Part part;
  part.constraint = Rows(side.L).middleRows(begin, end - begin);
  // Velocities that these rows ask for, numbered in their order.
  std::vector<int> number(static_cast<std::size_t>(side.L.cols()), -1);
  for (Eigen::Index k = 0; k < part.constraint.nonZeros(); ++k)
    number[static_cast<std::size_t>(part.constraint.innerIndexPtr()[k])] = 0;
  int asked = 0;
  for (int& k : number)
    if (k == 0)
      k = asked++;
  const Rows inverse_mass(side.inverse_mass);
  Rows of_asked(asked, inverse_mass.cols());
  for (Eigen::Index row = 0; row < inverse_mass.rows(); ++row)
    if (const int k = number[static_cast<std::size_t>(row)]; k >= 0)
    {
      of_asked.startVec(k);
      for (Rows::InnerIterator it(inverse_mass, row); it; ++it)
        of_asked.insertBack(k, it.col()) = it.value();
    }
  of_asked.finalize();
  part.response = of_asked * Rows(side.L.transpose());
  Rows constraint(end - begin, asked);
  for (Eigen::Index row = 0; row < constraint.rows(); ++row)
  {
    constraint.startVec(row);
    for (Rows::InnerIterator it(part.constraint, row); it; ++it)
      constraint.insertBack(row, number[static_cast<std::size_t>(it.col())]) = it.value();
  }
  constraint.finalize();
  part.constraint = std::move(constraint);

  part.velocity = Vector::Zero(asked);
  part.diagonal = Vector::Zero(end - begin);
  for (Eigen::Index row = 0; row < end - begin; ++row)
    for (Rows::InnerIterator it(part.constraint, row); it; ++it)
      part.diagonal[row] += it.value() * part.response.coeff(it.col(), begin + row);
  return part;
}

Gradients::Gradients(const std::array<InterfaceSide, 2>& side, const link::Team* team)
    : team_(team), n_(side[0].L.rows())
{
  const auto ranks = static_cast<std::size_t>(team_ == nullptr ? 1 : team_->size()),
             rank = static_cast<std::size_t>(team_ == nullptr ? 0 : team_->rank());
  const auto n = static_cast<std::size_t>(n_), n_blocks = (n + block - 1) / block;
  for (std::size_t r = 0; r < ranks; ++r)
  {
    const std::size_t from = n_blocks * r / ranks, to = n_blocks * (r + 1) / ranks;
    blocks_.own.push_back({from, to});
    blocks_.wanted.push_back({0, n_blocks});
    rows_.own.push_back({std::min(n, block * from), std::min(n, block * to)});
    rows_.wanted.push_back({0, n});
  }
  if (leads())
    hand_out(side);
  block_sum_.resize(n_blocks);
  begin_ = static_cast<Eigen::Index>(rows_.own[rank][0]);
  size_ = static_cast<Eigen::Index>(rows_.own[rank][1]) - begin_;

  diagonal_ = Vector::Zero(n_);
  std::size_t lowest = n, highest = 0;
  for (const Side s : both_sides)
  {
    part_[s] = part_of(side[s], begin_, begin_ + size_);
    diagonal_.segment(begin_, size_) += part_[s].diagonal;
    for (Eigen::Index k = 0; k < part_[s].response.nonZeros(); ++k)
    {
      const auto row = static_cast<std::size_t>(part_[s].response.innerIndexPtr()[k]);
      lowest = std::min(lowest, row);
      highest = std::max(highest, row + 1);
    }
  }
  share(diagonal_.data(), rows_);
  movable_ = movable_rows(diagonal_).segment(begin_, size_);
  // From now on, what this rank wants.
  std::vector<double> wanted(2 * ranks);
  link::Stretches pairs;
  for (std::size_t r = 0; r < ranks; ++r)
  {
    pairs.own.push_back({2 * r, 2 * r + 2});
    pairs.wanted.push_back({0, 2 * ranks});
  }
  wanted[2 * rank] = static_cast<double>(lowest);
  wanted[2 * rank + 1] = static_cast<double>(highest);
  share(wanted.data(), pairs);
  for (std::size_t r = 0; r < ranks; ++r)
    rows_.wanted[r] = {static_cast<std::size_t>(wanted[2 * r]), static_cast<std::size_t>(wanted[2 * r + 1])};
}

void Gradients::hand_out(const std::array<InterfaceSide, 2>& side) const
{
  std::vector<std::byte> task;
  link::wire::Writer(task).i32(static_cast<std::int32_t>(Task::rows));
  team_->tell(std::move(task));
  std::vector<std::vector<std::byte>> needed(rows_.own.size());
  for (const InterfaceSide& s : side)
  {
    const Rows L(s.L), inverse_mass(s.inverse_mass);
    for (std::size_t r = 1; r < needed.size(); ++r)
    {
      link::wire::Writer out(needed[r]);
      write_needed(out, L, s.L, inverse_mass, static_cast<Eigen::Index>(rows_.own[r][0]),
                   static_cast<Eigen::Index>(rows_.own[r][1]));
    }
  }
  team_->hand_out(std::move(needed));
}

void Gradients::share(double* all, const link::Stretches& stretches) const
{
  if (team_ != nullptr)
    team_->share(all, stretches);
}

void Gradients::apply(const std::array<double, 2>& weights, const Vector& x, Vector& Hx)
{
  Hx.setZero();
  for (const Side s : both_sides)
  {
    Part& part = part_[s];
    for_each_row(part.response, x, [&](Eigen::Index row, double sum) { part.velocity[row] = sum; });
    for_each_row(part.constraint, part.velocity,
                 [&](Eigen::Index row, double sum) { Hx[row] += weights[s] * sum; });
  }
}

double Gradients::dot(const double* a, const double* b)
{
  const std::size_t first = static_cast<std::size_t>(begin_) / block, n = static_cast<std::size_t>(size_);
  for (std::size_t at = 0, k = first; at < n; at += block, ++k)
  {
    std::array<double, 4> sum{};
    const std::size_t end = std::min(n, at + block);
    for (std::size_t i = at; i < end; ++i)
      sum[i % 4] += a[i] * b[i];
    block_sum_[k] = (sum[0] + sum[1]) + (sum[2] + sum[3]);
  }
  share(block_sum_.data(), blocks_);
  double sum = 0.0;
  for (const double s : block_sum_)
    sum += s;
  return sum;
}

Gradients::Solution Gradients::solve(const std::array<double, 2>& weights, const Vector& rhs,
                                     const Vector& start)
{
  if (leads())
  {
    std::vector<std::byte> task;
    link::wire::Writer out(task);
    out.i32(static_cast<std::int32_t>(Task::solution));
    out.f64(weights[0]);
    out.f64(weights[1]);
    team_->tell(std::move(task));
    std::vector<std::vector<std::byte>> needed(rows_.own.size());
    for (std::size_t r = 1; r < needed.size(); ++r)
    {
      link::wire::Writer part(needed[r]);
      part.list<double>(stretch(as_span(rhs), rows_.own[r]));
      part.list<double>(stretch(as_span(start), rows_.wanted[r]));
    }
    team_->hand_out(std::move(needed));
  }
  Vector inverse(size_); // of D, and zero in rows without movable mass: then z, p and λ are zero there
  for (Eigen::Index i = 0; i < size_; ++i)
  {
    const double d = weights[0] * part_[0].diagonal[i] + weights[1] * part_[1].diagonal[i];
    inverse[i] = movable_[i] && d > 0.0 ? 1.0 / d : 0.0;
  }
  Vector p = start, q(size_), r = rhs.segment(begin_, size_), x = start.segment(begin_, size_);
  Vector z = inverse.cwiseProduct(r);
  double* const own_p = p.data() + begin_;
  const double scale = dot(r.data(), z.data());
  apply(weights, p, q);
  r -= q;
  z = inverse.cwiseProduct(r);
  double rz = dot(r.data(), z.data());
  if (!(rz < scale))
  {
    x.setZero();
    r = rhs.segment(begin_, size_);
    z = inverse.cwiseProduct(r);
    rz = scale;
  }

  Solution solution;
  solution.found = true;
  p.segment(begin_, size_) = z;
  while (rz > tolerance * tolerance * scale)
  {
    share(p.data(), rows_);
    apply(weights, p, q);
    const double pq = dot(own_p, q.data());
    solution.found = pq > 0.0 && solution.iterations < most;
    if (!solution.found)
      break;
    ++solution.iterations;
    const double alpha = rz / pq;
    x += alpha * p.segment(begin_, size_);
    r -= alpha * q;
    z = inverse.cwiseProduct(r);
    const double before = std::exchange(rz, dot(r.data(), z.data()));
    p.segment(begin_, size_) = z + (rz / before) * p.segment(begin_, size_);
  }

  if (team_ == nullptr)
  {
    solution.lambda = std::move(x);
    return solution;
  }
  const auto parts = team_->collect(std::as_bytes(as_span(x)));
  solution.lambda.resize(parts.empty() ? 0 : n_);
  auto* to = reinterpret_cast<std::byte*>(solution.lambda.data());
  for (const auto& part : parts)
    to = std::copy(part.begin(), part.end(), to);
  return solution;
}

Gradients Gradients::receive(const link::Team& team)
{
  const auto bytes = team.hand_out({});
  link::wire::Reader in(bytes, "rows of a helper");
  std::array<InterfaceSide, 2> side;
  for (InterfaceSide& s : side)
  {
    s.L = read_rows(in);
    s.inverse_mass = read_rows(in);
  }
  in.end();
  return {side, &team};
}

void Gradients::help(link::wire::Reader in)
{
  const std::array<double, 2> weights{in.f64("weight of the fluid"), in.f64("weight of the solid")};
  in.end();
  const auto bytes = team_->hand_out({});
  link::wire::Reader mine(bytes, "stretch of a helper");
  const auto rank = static_cast<std::size_t>(team_->rank());
  const Vector rhs = read_stretch(mine, "right-hand side", n_, rows_.own[rank]),
               start = read_stretch(mine, "start", n_, rows_.wanted[rank]);
  mine.end();
  solve(weights, rhs, start);
}

} // namespace undine::coupler
