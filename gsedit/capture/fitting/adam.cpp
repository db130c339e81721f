// Steps of Adam in one pass over rows of values and their moments, in place: lazy_adam.py says what
// each means, and has the same in torch. Compiled and called by lazy_adam.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "threads.h"

namespace {

template <typename T>
struct Job {
  T *value, *first, *second;  // [all rows, columns]
  const T* gradient;          // [count, columns]; null: zero
  const int64_t* rows;        // [count] that move; null: the first `count`
  const T* missed;            // [count] what each has to move by; only to settle
  const T *fade_1, *fade_2;   // [count] by which the moments of each are less; only to settle
  const T* shares;            // [columns] of the rate; null: 1
  int64_t count, columns, threads;
  double beta_1, beta_2, epsilon, rate, bias_2;  // the rate is over the bias of first moments
};

// A few rows' numbers, `to` in all rows and `from` in the gradient; `rates` as many.
template <typename T>
inline void move(const Job<T>& job, int64_t to, int64_t from, int64_t length, const T* rates) {
  const T beta_2 = T(job.beta_2), blend_1 = T(1 - job.beta_1), blend_2 = T(1 - job.beta_2);
  const T epsilon = T(job.epsilon), bias = T(job.bias_2);
  T *value = job.value + to, *first = job.first + to, *second = job.second + to;
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
  const T* gradient = job.gradient + from;
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
  for (int64_t i = from; i < to;) {  // neighbours at once
    const int64_t start = i++, end = std::min(to, start + ROWS);
    if (!job.rows) i = end;
    else while (i < end && job.rows[i] == job.rows[i - 1] + 1) i++;
    move(job, (job.rows ? job.rows[start] : start) * c, start * c, (i - start) * c, rates.data());
  }
}

template <typename T>
void settle(const Job<T>& job, int64_t from, int64_t to) {
  const T epsilon = T(job.epsilon);
  for (int64_t i = from; i < to; i++) {
    const int64_t at = (job.rows ? job.rows[i] : i) * job.columns;
    for (int64_t k = at; k < at + job.columns; k++) {
      const T distance = job.missed[i] * (job.shares ? job.shares[k - at] : T(1));
      job.value[k] -= job.first[k] / (std::sqrt(job.second[k]) + epsilon) * distance;
      job.first[k] *= job.fade_1[i];
      job.second[k] *= job.fade_2[i];
    }
  }
}

template <typename T>
int run(const Job<T>& job, void (*work)(const Job<T>&, int64_t, int64_t)) {
  // a thread costs as much as a few thousand rows
  const int64_t wanted = std::min<int64_t>(job.threads, job.count * job.columns / 16384);
  const int64_t parts = std::max<int64_t>(1, wanted);
  return !over_threads(job.threads, parts, [&](int64_t part) {
    work(job, part * job.count / parts, (part + 1) * job.count / parts);
  });
}

}  // namespace

extern "C" {
int step_float32(const Job<float>* job) { return run(*job, step<float>); }
int step_float64(const Job<double>* job) { return run(*job, step<double>); }
int settle_float32(const Job<float>* job) { return run(*job, settle<float>); }
int settle_float64(const Job<double>* job) { return run(*job, settle<double>); }
}
