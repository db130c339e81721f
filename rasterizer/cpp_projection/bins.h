// Which Gaussian touches which tile, in depth order: see tiles.py.
//
// An ellipse is FOOTPRINT numbers: x, y, the y of its rightmost point, its reach up and down, the
// shear, the variance of x at a given y, one over the variance of y, and the radius
// squared, -1 where it is never visible.
#pragma once

#include <algorithm>

#include "job.h"
#include "numbers.h"

constexpr int SIZES = 4;
constexpr int TILE_SIZES[SIZES] = {4, 8, 16, 32};  // as in tiles.py

template <typename V, typename Mask, typename T>
INLINE void footprint(V x, V y, V xx, V xy, V yy, V within, V radius, Mask hidden,
                      T (*out)[LANES]) {
  // rounding must never lose a pair: a superset is harmless, each pixel tests its own alpha
  radius = radius * T(1.0005) + T(1e-3);
  store(x, out[0]), store(y, out[1]);
  store(radius * xy / root(xx), out[2]);
  store(radius * root(yy), out[3]);
  store(xy / yy, out[4]);
  store(within, out[5]);
  store(1 / yy, out[6]);
  store(hidden ? V{} - 1 : radius * radius, out[7]);
}

// The first tile, and the one behind the last, with a pixel centre in [low, high].
template <typename T>
INLINE void tile_range(T low, T high, T per_size, T tiles, int32_t& first, int32_t& behind) {
  const T from = std::ceil((low + T(0.5)) * per_size - 1);
  const T to = std::floor((high - T(0.5)) * per_size);
  const T least = from > 0 ? from : T(0);  // NaN: all tiles
  const T most = to < tiles - 1 ? to : tiles - 1;
  first = int32_t(least < tiles ? least : tiles);
  behind = int32_t(most > -1 ? most : T(-1)) + 1;
}

// Spans of LANES (ellipse, row of tiles) at once.
template <typename T>
struct Block {
  T shape[FOOTPRINT][LANES], top[LANES];
  int32_t row[LANES], first[LANES], behind[LANES];

  void solve(T size, T per_size, T columns) {
#pragma omp simd
    for (int i = 0; i < LANES; i++) {
      const T tip = shape[2][i], reach = shape[3][i], shear = shape[4][i], within = shape[5][i];
      const T bottom = top[i] + size - 1;
      T edges[2];
      for (int side = 0; side < 2; side++) {
        const T sign = side ? T(1) : T(-1);
        T dy = std::min(std::max(sign * tip, top[i]), bottom);
        dy = std::min(std::max(dy, -reach), reach);
        const T left = std::max(shape[7][i] - dy * dy * shape[6][i], T(0));
        edges[side] = shape[0][i] + shear * dy + sign * std::sqrt(within * left);
      }
      tile_range(edges[0], edges[1], per_size, columns, first[i], behind[i]);
    }
  }
};

// Rows of tiles of every ellipse, summed up: first_span[i] is where those of i begin.
template <typename T>
inline void count_rows(const Job<T>& job, const T* shapes, int64_t* first_span, int32_t* top_row) {
  const T per_size = T(1) / T(job.tile_size), rows = T(job.tile_rows);
  in_parallel(job.threads, job.drawn, 1 << 13, 1, [&](int64_t begin, int64_t end, int64_t) {
    for (int64_t i = begin; i < end; i++) {
      const T* s = shapes + i * FOOTPRINT;
      int32_t first, behind;
      tile_range(s[1] - s[3], s[1] + s[3], per_size, rows, first, behind);
      const bool none = s[7] < 0;  // it is never visible
      top_row[i] = first;
      first_span[i + 1] = none ? 0 : std::max(0, behind - first);
    }
  });
  first_span[0] = 0;
  for (int64_t i = 0; i < job.drawn; i++) first_span[i + 1] += first_span[i];
}

// The tiles of every span; counts the Gaussians of each tile into differences[tile], of which the
// running sum is the number, and the pairs of each Gaussian into firsts[i].
template <typename T>
inline void fill_spans(const Job<T>& job, const T* shapes, const int64_t* first_span,
                       const int32_t* top_row, Span* spans, int64_t begin, int64_t end,
                       int64_t* differences) {
  Block<T> block;
  int64_t owners[LANES];
  const T size = T(job.tile_size), per_size = T(1) / size;
  int lane = 0;
  int64_t next = first_span[begin];
  const auto flush = [&] {
    block.solve(size, per_size, T(job.columns));
    for (int i = 0; i < lane; i++) {
      const int32_t count = std::max(0, block.behind[i] - block.first[i]);
      const int32_t tile = int32_t(block.row[i] * job.columns) + block.first[i];
      spans[next++] = {tile, count};
      differences[tile]++, differences[tile + count]--;
      job.firsts[owners[i]] += count;
    }
    lane = 0;
  };
  for (int k = 0; k < FOOTPRINT; k++)
    for (int i = 0; i < LANES; i++) block.shape[k][i] = T(1);
  std::fill_n(block.top, LANES, T(0));
  for (int64_t i = begin; i < end; i++) {
    job.firsts[i] = 0;
    const int32_t rows = int32_t(first_span[i + 1] - first_span[i]);
    for (int32_t r = 0; r < rows; r++) {
      for (int k = 0; k < FOOTPRINT; k++) block.shape[k][lane] = shapes[i * FOOTPRINT + k];
      const int32_t row = top_row[i] + r;
      block.row[lane] = row;
      block.top[lane] = T(row * job.tile_size) + T(0.5) - shapes[i * FOOTPRINT + 1];
      owners[lane] = i;
      if (++lane == LANES) flush();
    }
  }
  flush();
}

// A number's bits, such that they are ordered as the numbers are.
INLINE uint64_t ordered(double depth) {
  depth += 0.0;  // -0 is 0
  uint64_t bits;
  std::memcpy(&bits, &depth, sizeof bits);
  return bits >> 63 ? ~bits : bits | uint64_t(1) << 63;
}

// Front to back; equal depths keep their order.
inline void sort_few(uint64_t* begin, uint64_t* end, const double* depths) {
  const auto depth = [&](uint64_t key) { return depths[uint32_t(key)]; };
  if (end - begin > 16) {
    std::stable_sort(begin, end, [&](uint64_t a, uint64_t b) { return depth(a) < depth(b); });
    return;
  }
  for (uint64_t* at = begin + 1; at < end; at++) {  // stable_sort would allocate
    const uint64_t key = *at;
    uint64_t* to = at;
    for (; to > begin && depth(key) < depth(to[-1]); to--) *to = to[-1];
    *to = key;
  }
}

// Indices of those Gaussians that have spans, front to back, in the low halves of what is returned;
// equal depths keep their order. A radix sort by the bits in which the depths differ most, and then
// of the few that agree in those.
inline uint64_t* depth_order(Scratch& scratch, int64_t threads, const double* depths,
                             const int64_t* first_span, int64_t drawn, int64_t& visible) {
  constexpr int64_t LEAST = 1 << 13;  // that are worth a thread
  uint64_t* keys = scratch.keys.at_least(drawn + 1);
  uint64_t* moved = scratch.keys_moved.at_least(drawn + 1);
  uint64_t least = ~uint64_t(0), most = 0;
  visible = 0;
  for (int64_t i = 0; i < drawn; i++) {
    if (first_span[i + 1] == first_span[i]) continue;
    const uint64_t key = ordered(depths[i]);
    least = std::min(least, key), most = std::max(most, key);
    keys[visible++] = uint64_t(i);
  }
  if (!visible) return keys;
  // few that agree are sorted sooner than all are moved once more
  const int passes = visible < 1 << 17 ? 2 : 3, digit = passes == 2 ? 12 : 11, values = 1 << digit;
  const int most_bits = std::min(32, passes * digit);
  int bits = 0;  // in which they differ
  while (bits < 64 && (most - least) >> bits) bits++;
  const int shift = std::max(0, bits - most_bits);
  in_parallel(threads, visible, LEAST, 1, [&](int64_t begin, int64_t end, int64_t) {
    for (int64_t i = begin; i < end; i++)
      keys[i] |= (ordered(depths[keys[i]]) - least) >> shift << 32;
  });
  const int64_t parts = parts_of(threads, visible, LEAST);
  int32_t* counts = scratch.digits.at_least(parts << digit);
  for (int pass = 0; pass < passes; pass++) {
    const auto value = [&, at = 32 + digit * pass](uint64_t key) { return key >> at & (values - 1); };
    std::fill_n(counts, parts << digit, 0);
    in_parallel(threads, visible, LEAST, 1, [&](int64_t begin, int64_t end, int64_t part) {
      int32_t* count = counts + (part << digit);
      for (int64_t i = begin; i < end; i++) count[value(keys[i])]++;
    });
    int32_t sum = 0;
    for (int v = 0; v < values; v++)
      for (int64_t part = 0; part < parts; part++) {
        int32_t& count = counts[(part << digit) + v];
        const int32_t here = count;
        count = sum, sum += here;
      }
    in_parallel(threads, visible, LEAST, 1, [&](int64_t begin, int64_t end, int64_t part) {
      int32_t* next = counts + (part << digit);
      for (int64_t i = begin; i < end; i++) moved[next[value(keys[i])]++] = keys[i];
    });
    std::swap(keys, moved);
  }
  for (int64_t i = 0; shift && i < visible;) {
    const int64_t first = i++;
    while (i < visible && keys[i] >> 32 == keys[first] >> 32) i++;
    if (i > first + 1) sort_few(keys + first, keys + i, depths);
  }
  return keys;
}
