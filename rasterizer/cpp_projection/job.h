// What the caller passes (kernel.py has the same structure), and what is kept from one call to the
// next.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

#include "numbers.h"
#include "threads.h"

constexpr int GEOMETRY = 6;  // columns of the table before the colour: x, y, w0, w1, w2, log opacity
constexpr int FOOTPRINT = 8; // numbers that describe an ellipse, see bins.h

template <typename T>
struct Job {
  // the scene; `linear`: scales and opacities, not their logarithms and logits
  const T *means, *quats, *log_scales, *logits, *sh;
  int64_t count, bands, linear;  // Gaussians; harmonics a channel, 0: the table has no colours
  // the camera, and the rectangle of its pixels
  double pose[12];  // three rows of the rotation and the translation
  double focal_x, focal_y, centre_x, centre_y;
  double slopes[4];  // low x, high x, low y, high y
  int64_t left, top, width, height;
  int64_t orthographic;
  // the settings
  double near, far, blur, alpha_min, log_alpha_min, least_logit, radius_clip, pair_overhead;
  int64_t antialiased, with_depth, threads;
  int64_t tile_size;  // 0: choose; then the one that was chosen
  void* scratch;
  // of the `drawn` Gaussians that may touch the rectangle
  int64_t drawn;
  int32_t* rows;    // [drawn]: ascending
  T* table;         // [drawn, columns_of_table()]
  T* depths;        // [drawn], or null
  T* centers;       // [count, 2]: x and y of those that are drawn, or null
  uint8_t* shown;   // [drawn]: bit c is set where channel c is not clamped
  // the tiles' lists
  int64_t pairs, columns, tile_rows;
  int64_t *members, *slots;  // [pairs]
  int64_t* starts;           // [tiles + 1]
  int64_t* firsts;           // [drawn]: slot at which each Gaussian's pairs begin
  // the way back
  const T* pair_gradients;  // [pairs, columns of the table], by slot
  T* grad_centers;          // [count, 2]: of x and y, instead of the pairs'; or null
  T* grad_table;            // [drawn, columns of the pairs' gradients]
  int64_t grad_columns;
  T *grad_means, *grad_quats, *grad_log_scales, *grad_logits, *grad_sh;  // dense; or null

  int64_t depth_column() const { return GEOMETRY + (bands ? 3 : 0); }
  int64_t columns_of_table() const { return depth_column() + with_depth; }
};

// Memory that is kept from call to call, grows as needed and is not set to anything.
template <typename V>
class Buffer {
 public:
  Buffer() = default;
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  ~Buffer() { ::operator delete(data_, LINE); }
  V* at_least(size_t count) {
    if (count > capacity_) {
      ::operator delete(data_, LINE);
      capacity_ = 0;
      data_ = static_cast<V*>(::operator new(count * sizeof(V), LINE, std::nothrow));
      if (!data_) throw std::bad_alloc();
      capacity_ = count;
    }
    return data_;
  }
  V* data() { return data_; }

 private:
  static constexpr std::align_val_t LINE{64};
  V* data_ = nullptr;
  size_t capacity_ = 0;
};

struct Span {  // tiles of one row that an ellipse touches
  int32_t tile, count;
};

struct Scratch {
  Buffer<int32_t> rows;
  Buffer<double> depths;
  Buffer<double> footprints;  // or floats
  Buffer<int64_t> first_span;
  Buffer<Span> spans;
  Buffer<uint64_t> keys, keys_moved;
  Buffer<int64_t> counts;
  Buffer<int32_t> digits;
};

// How many parts in_parallel makes.
inline int64_t parts_of(int64_t threads, int64_t count, int64_t least) {
  return std::max<int64_t>(1, std::min(threads, count / least));
}

// work(begin, end, part) over parts of [0, count), which do not depend on timing: multiples of
// `step` but for the last, worth a thread from `least` on.
template <typename Work>
void in_parallel(int64_t threads, int64_t count, int64_t least, int64_t step, Work work) {
  const int64_t parts = parts_of(threads, count, least);
  const int64_t size = ((count + parts - 1) / parts + step - 1) / step * step;
  if (!over_threads(threads, parts, [&](int64_t part) {
        work(std::min(part * size, count), std::min((part + 1) * size, count), part);
      }))
    throw std::bad_alloc();
}
