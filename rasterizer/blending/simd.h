// Vectors as wide as the processor's, of float or double, in extensions that GCC and Clang share.
#pragma once

#include <cstdint>
#include <cstring>
#include <utility>

#if defined(__AVX512F__)
constexpr int BYTES = 64;  // of a vector
#elif defined(__AVX__)
constexpr int BYTES = 32;
#else
constexpr int BYTES = 16;
#endif

template <typename T>
struct Simd;

template <>
struct Simd<float> {
  typedef float Vector __attribute__((vector_size(BYTES)));
  typedef int32_t Integers __attribute__((vector_size(BYTES)));
  typedef uint32_t Bits __attribute__((vector_size(BYTES)));
  static constexpr int MANTISSA = 23;
  // 2^x on [-0.5, 0.5]: the polynomial whose largest relative error, 2e-9, is least
  static constexpr float EXP2[] = {1.f, 0.693147206f, 0.240226469f, 0.0555032878f,
                                   0.00961848896f, 0.00133999314f, 0.000153458121f};
};

template <>
struct Simd<double> {
  typedef double Vector __attribute__((vector_size(BYTES)));
  typedef int64_t Integers __attribute__((vector_size(BYTES)));
  typedef uint64_t Bits __attribute__((vector_size(BYTES)));
  static constexpr int MANTISSA = 52;
  // the Taylor series
  static constexpr double EXP2[] = {
      1, 0.69314718055994529, 0.24022650695910069, 0.055504108664821576, 0.0096181291076284769,
      0.0013333558146428441, 0.00015403530393381606, 1.5252733804059838e-05,
      1.3215486790144305e-06, 1.0178086009239696e-07, 7.0549116208011209e-09,
      4.4455382718708101e-10, 2.5678435993488196e-11, 1.3691488853904124e-12};
};

template <typename T>
using V = typename Simd<T>::Vector;
template <typename T>
using I = typename Simd<T>::Integers;  // as wide as T; what comparisons give: -1 or 0
template <typename T>
constexpr int LANES = BYTES / sizeof(T);

template <typename T>
inline V<T> load(const T* at) {
  V<T> v;
  std::memcpy(&v, at, sizeof v);
  return v;
}

template <typename T>
inline void store(T* at, V<T> v) {
  std::memcpy(at, &v, sizeof v);
}

// 2^x to an ulp, for |x| < 2^7 (double: 2^10); elsewhere it is anything.
template <typename T>
inline V<T> exp2(V<T> x) {
  using S = Simd<T>;
  using Bits = typename S::Bits;
  constexpr T magic = T(1.5) * T(int64_t(1) << S::MANTISSA);  // its sum with x is rounded to a unit
  constexpr int degree = sizeof(S::EXP2) / sizeof(T) - 1;
  const V<T> n = x + magic, r = x - (n - magic);
  V<T> p = r * S::EXP2[degree] + S::EXP2[degree - 1];
  for (int i = degree - 2; i >= 0; i--) p = p * r + S::EXP2[i];
  return (V<T>)((Bits)p + ((Bits)n << S::MANTISSA));
}

template <int N>
struct Words {
  typedef uint64_t Type __attribute__((vector_size(N)));
};

template <int N>
inline bool any_bit(typename Words<N>::Type words) {
  if constexpr (N == 16) {
    return words[0] | words[1];
  } else {
    typename Words<N / 2>::Type halves[2];
    std::memcpy(halves, &words, N);
    return any_bit<N / 2>(halves[0] | halves[1]);
  }
}

// Whether a comparison is true in any lane.
template <typename M>
inline bool any(M mask) {
  return any_bit<BYTES>((typename Words<BYTES>::Type)mask);
}

#ifdef __clang__
#define SHUFFLE(T, a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define SHUFFLE(T, a, b, ...) __builtin_shuffle(a, b, I<T>{__VA_ARGS__})
#endif

// In each segment of S lanes: the sum of a's halves, then that of b's.
template <typename T, int S, int... L>
inline V<T> fold(V<T> a, V<T> b, std::integer_sequence<int, L...>) {
  constexpr int H = S / 2, B = LANES<T> - H;  // from a lane of a's first half to one of b's
  const V<T> low = SHUFFLE(T, a, b, (L % S < H ? L : L + B)...);
  const V<T> high = SHUFFLE(T, a, b, (L % S < H ? L + H : L + B + H)...);
  return low + high;
}
#undef SHUFFLE

// Lane l of the result is the sum of the lanes of v[l]. Overwrites v.
template <typename T, int S = LANES<T>>
inline V<T> sums_of_lanes(V<T>* v) {
  if constexpr (S == 1) {
    return v[0];
  } else {
    constexpr auto lanes = std::make_integer_sequence<int, LANES<T>>();
    for (int i = 0; i < S / 2; i++) v[i] = fold<T, S>(v[i], v[i + S / 2], lanes);
    return sums_of_lanes<T, S / 2>(v);
  }
}
