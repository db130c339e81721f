// Steps of Adam in one pass over rows of values and their moments, in place: adam.py says what
// each means, and has the same in torch. Compiled and called by adam.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "threads.h"

namespace {

template <typename T>
struct Job {
  T *value, *first, *second;  // [count, columns]
  const T* gradient;          // [count, columns]; null: zero
  const T* shares;            // [columns] of the rate; null: 1
  int64_t count, columns, threads;
  double beta_1, beta_2, epsilon, rate, bias_2;  // the rate is over the bias of first moments
};

// A few rows' numbers from `at` on; `rates` as many.
template <typename T>
inline void move(const Job<T>& job, int64_t at, int64_t length, const T* rates) {
  const T beta_2 = T(job.beta_2), blend_1 = T(1 - job.beta_1), blend_2 = T(1 - job.beta_2);
  const T epsilon = T(job.epsilon), bias = T(job.bias_2);
  T *value = job.value + at, *first = job.first + at, *second = job.second + at;
  if (!job.gradient) {
    const T beta_1 = T(job.beta_1);
#pragma omp simd
    for (int64_t i = 0; i < length; i++) {
      first[i] *= beta_1;
      second[i] *= beta_2;
      value[i] -= rates[i] * first[i] / (std::sqrt(second[i]) / bias + epsilon);
    }
    return;
  }
  const T* gradient = job.gradient + at;
#pragma omp simd
  for (int64_t i = 0; i < length; i++) {
    const T g = gradient[i];
    first[i] += blend_1 * (g - first[i]);
    second[i] = beta_2 * second[i] + blend_2 * g * g;
    value[i] -= rates[i] * first[i] / (std::sqrt(second[i]) / bias + epsilon);
  }
}

template <typename T>
void step(const Job<T>& job, int64_t from, int64_t to) {
  constexpr int64_t ROWS = 64;  // at once, at most
  const int64_t c = job.columns;
  std::vector<T> rates(ROWS * c);
  for (int64_t i = 0; i < ROWS * c; i++)
    rates[i] = T(job.rate) * (job.shares ? job.shares[i % c] : T(1));
  for (int64_t i = from; i < to; i += ROWS)
    move(job, i * c, (std::min(to, i + ROWS) - i) * c, rates.data());
}

template <typename T>
int run(const Job<T>& job) {
  // a thread costs as much as a few thousand rows
  const int64_t wanted = std::min<int64_t>(job.threads, job.count * job.columns / 16384);
  const int64_t parts = std::max<int64_t>(1, wanted);
  return !over_threads(job.threads, parts, [&](int64_t part) {
    step(job, part * job.count / parts, (part + 1) * job.count / parts);
  });
}

}  // namespace

extern "C" {
int step_float32(const Job<float>* job) { return run(*job); }
int step_float64(const Job<double>* job) { return run(*job); }
}
