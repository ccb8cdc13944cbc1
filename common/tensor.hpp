// Small fixed-size vectors and matrices over any number type (double, or a SIMD lane type in kernels).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace undine
{

/// Vector of `dim` components; an aggregate, so that `std::vector<Vec<dim>>` is a contiguous (n, dim) array.
template <int dim, class Real = double>
struct Vec
{
  std::array<Real, dim> c{};

  constexpr Real& operator[](int i) { return c[static_cast<std::size_t>(i)]; }
  constexpr const Real& operator[](int i) const { return c[static_cast<std::size_t>(i)]; }

  constexpr Vec& operator+=(const Vec& b)
  {
    for (int i = 0; i < dim; ++i)
      (*this)[i] += b[i];
    return *this;
  }
  constexpr Vec& operator-=(const Vec& b)
  {
    for (int i = 0; i < dim; ++i)
      (*this)[i] -= b[i];
    return *this;
  }
  constexpr Vec& operator*=(const Real& s)
  {
    for (int i = 0; i < dim; ++i)
      (*this)[i] *= s;
    return *this;
  }
  friend constexpr Vec operator+(Vec a, const Vec& b) { return a += b; }
  friend constexpr Vec operator-(Vec a, const Vec& b) { return a -= b; }
  friend constexpr Vec operator-(const Vec& a) { return Vec{} - a; }
  friend constexpr Vec operator*(Vec a, const Real& s) { return a *= s; }
  friend constexpr Vec operator*(const Real& s, Vec a) { return a *= s; }
  friend constexpr bool operator==(const Vec&, const Vec&) = default;
};

/// The first `dim` of three components: cases name points and vectors in space.
template <int dim>
constexpr Vec<dim> leading(const std::array<double, 3>& a)
{
  Vec<dim> v;
  for (int i = 0; i < dim; ++i)
    v[i] = a[static_cast<std::size_t>(i)];
  return v;
}

template <int dim, class Real>
constexpr Real dot(const Vec<dim, Real>& a, const Vec<dim, Real>& b)
{
  Real s = a[0] * b[0];
  for (int i = 1; i < dim; ++i)
    s += a[i] * b[i];
  return s;
}

template <int dim, class Real>
constexpr Real norm_squared(const Vec<dim, Real>& a)
{
  return dot(a, a);
}

template <int dim>
double norm(const Vec<dim>& a)
{
  return std::sqrt(dot(a, a));
}

template <class Real>
constexpr Vec<3, Real> cross(const Vec<3, Real>& a, const Vec<3, Real>& b)
{
  return {{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]}};
}

/// The vector `a` turned by −90°: the normal to the right of a plane curve running along `a`.
template <class Real>
constexpr Vec<2, Real> right_normal(const Vec<2, Real>& a)
{
  return {{a[1], Real(0) - a[0]}};
}

/// Square matrix, row by row: A(i, j) is row i, column j.
template <int dim, class Real = double>
struct Mat
{
  std::array<Real, dim * dim> c{};

  constexpr Real& operator()(int i, int j) { return c[static_cast<std::size_t>(i * dim + j)]; }
  constexpr const Real& operator()(int i, int j) const { return c[static_cast<std::size_t>(i * dim + j)]; }

  static constexpr Mat identity()
  {
    Mat a;
    for (int i = 0; i < dim; ++i)
      a(i, i) = Real(1);
    return a;
  }
  constexpr Mat& operator+=(const Mat& b)
  {
    for (std::size_t k = 0; k < c.size(); ++k)
      c[k] += b.c[k];
    return *this;
  }
  constexpr Mat& operator-=(const Mat& b)
  {
    for (std::size_t k = 0; k < c.size(); ++k)
      c[k] -= b.c[k];
    return *this;
  }
  constexpr Mat& operator*=(const Real& s)
  {
    for (auto& x : c)
      x *= s;
    return *this;
  }
  friend constexpr Mat operator+(Mat a, const Mat& b) { return a += b; }
  friend constexpr Mat operator-(Mat a, const Mat& b) { return a -= b; }
  friend constexpr Mat operator*(Mat a, const Real& s) { return a *= s; }
  friend constexpr Mat operator*(const Real& s, Mat a) { return a *= s; }
  friend constexpr bool operator==(const Mat&, const Mat&) = default;
};

template <int dim, class Real>
constexpr Vec<dim, Real> operator*(const Mat<dim, Real>& a, const Vec<dim, Real>& x)
{
  Vec<dim, Real> y;
  for (int i = 0; i < dim; ++i)
  {
    Real s = a(i, 0) * x[0];
    for (int j = 1; j < dim; ++j)
      s += a(i, j) * x[j];
    y[i] = s;
  }
  return y;
}

template <int dim, class Real>
constexpr Mat<dim, Real> operator*(const Mat<dim, Real>& a, const Mat<dim, Real>& b)
{
  Mat<dim, Real> m;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
    {
      Real s = a(i, 0) * b(0, j);
      for (int k = 1; k < dim; ++k)
        s += a(i, k) * b(k, j);
      m(i, j) = s;
    }
  return m;
}

template <int dim, class Real>
constexpr Mat<dim, Real> transpose(const Mat<dim, Real>& a)
{
  Mat<dim, Real> t;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
      t(i, j) = a(j, i);
  return t;
}

template <int dim, class Real>
constexpr Real trace(const Mat<dim, Real>& a)
{
  Real s = a(0, 0);
  for (int i = 1; i < dim; ++i)
    s += a(i, i);
  return s;
}

template <int dim, class Real>
constexpr Mat<dim, Real> outer(const Vec<dim, Real>& a, const Vec<dim, Real>& b)
{
  Mat<dim, Real> m;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
      m(i, j) = a[i] * b[j];
  return m;
}

/// Double contraction A : B.
template <int dim, class Real>
constexpr Real contract(const Mat<dim, Real>& a, const Mat<dim, Real>& b)
{
  Real s = a.c[0] * b.c[0];
  for (std::size_t k = 1; k < a.c.size(); ++k)
    s += a.c[k] * b.c[k];
  return s;
}

template <int dim, class Real>
constexpr Mat<dim, Real> symmetric_part(const Mat<dim, Real>& a)
{
  return Real(0.5) * (a + transpose(a));
}

template <class Real>
constexpr Real determinant(const Mat<2, Real>& a)
{
  return a(0, 0) * a(1, 1) - a(0, 1) * a(1, 0);
}

template <class Real>
constexpr Real determinant(const Mat<3, Real>& a)
{
  return a(0, 0) * (a(1, 1) * a(2, 2) - a(1, 2) * a(2, 1)) -
         a(0, 1) * (a(1, 0) * a(2, 2) - a(1, 2) * a(2, 0)) +
         a(0, 2) * (a(1, 0) * a(2, 1) - a(1, 1) * a(2, 0));
}

/// Transposed matrix of cofactors: adjugate(A) = det(A) A⁻¹.
template <class Real>
constexpr Mat<2, Real> adjugate(const Mat<2, Real>& a)
{
  return {{a(1, 1), Real(0) - a(0, 1), Real(0) - a(1, 0), a(0, 0)}};
}

template <class Real>
constexpr Mat<3, Real> adjugate(const Mat<3, Real>& a)
{
  Mat<3, Real> m;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
    {
      const int r = (j + 1) % 3, s = (j + 2) % 3, p = (i + 1) % 3, q = (i + 2) % 3;
      m(i, j) = a(r, p) * a(s, q) - a(r, q) * a(s, p);
    }
  return m;
}

template <int dim, class Real>
constexpr Mat<dim, Real> inverse(const Mat<dim, Real>& a)
{
  return adjugate(a) * (Real(1) / determinant(a));
}

} // namespace undine
