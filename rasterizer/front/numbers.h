// Vectors of three, and the functions of a number that a compiler can compute for many at once.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

template <typename T>
struct Vec {
  T x, y, z;
};
template <typename T>
inline Vec<T> operator+(Vec<T> a, Vec<T> b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
template <typename T>
inline Vec<T> operator-(Vec<T> a, Vec<T> b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
template <typename T>
inline Vec<T> operator*(T s, Vec<T> a) { return {s * a.x, s * a.y, s * a.z}; }
template <typename T>
inline Vec<T> scaled(Vec<T> a, Vec<T> b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
template <typename T>
inline T dot(Vec<T> a, Vec<T> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <typename T>
inline Vec<T> cross(Vec<T> a, Vec<T> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline float power_of_two(int32_t n) {  // -126 to 127
  const int32_t bits = (n + 127) << 23;
  float power;
  std::memcpy(&power, &bits, sizeof power);
  return power;
}

// exp of any number, to an ulp or two: 2^n times the Taylor series of what remains,
// |r| <= ln2 / 2.
inline float exponential(float x) {
  x = std::min(std::max(x, -104.0f), 89.0f);  // beyond, 0 and infinity
  const float n = std::nearbyint(x * 1.44269504f);
  const float r = std::fma(n, 1.90465420e-09f, std::fma(n, -0.693147183f, x));
  float s = 1.0f / 5040;
  s = s * r + 1.0f / 720, s = s * r + 1.0f / 120, s = s * r + 1.0f / 24, s = s * r + 1.0f / 6;
  s = s * r + 0.5f, s = s * r + 1.0f, s = s * r + 1.0f;
  const int32_t whole = static_cast<int32_t>(n), half = whole >> 1;
  return s * power_of_two(half) * power_of_two(whole - half);
}
inline double exponential(double x) { return std::exp(x); }

// log(1 + u) for 0 <= u <= 1: 2 artanh(u / (2 + u)), by its series
inline float log_one_plus(float u) {
  const float t = u / (2 + u), q = t * t;
  float s = 1.0f / 15;
  s = s * q + 1.0f / 13, s = s * q + 1.0f / 11, s = s * q + 1.0f / 9, s = s * q + 1.0f / 7;
  s = s * q + 1.0f / 5, s = s * q + 1.0f / 3;
  return 2 * (t + t * q * s);
}
inline double log_one_plus(double u) { return std::log1p(u); }

// log of a normal number above 0: of m in [1/sqrt 2, sqrt 2), plus n log 2
inline float logarithm(float x) {
  int32_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  const int32_t n = (bits - 0x3f3504f3) >> 23;  // 0x3f3504f3 is sqrt(1/2)
  bits -= n << 23;
  float m;
  std::memcpy(&m, &bits, sizeof m);
  const float f = m - 1, t = f / (2 + f), q = t * t;
  float s = 1.0f / 9;
  s = s * q + 1.0f / 7, s = s * q + 1.0f / 5, s = s * q + 1.0f / 3;
  return n * 0.693147183f + (n * -1.90465430e-09f + 2 * (t + t * q * s));
}
inline double logarithm(double x) { return std::log(x); }

template <typename T>
inline T inverse_root(T x) { return T(1) / std::sqrt(x); }

// In [low, high]; `low` for NaN.
template <typename T>
inline T held(T x, T low, T high) { return std::min(std::max(low, x), high); }
