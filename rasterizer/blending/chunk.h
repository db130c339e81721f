// A cell of pixels, and CHUNK Gaussians of its list: which of the cell's blocks each reaches.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "simd.h"

constexpr int GEOMETRY = 6;  // x, y, w0, w1, w2, log opacity; then the features
constexpr int CHUNK = 16;

template <typename T>
struct Job {
  const T* table;              // [m, GEOMETRY + depth]
  const int64_t* members;      // [pairs]
  const int64_t* starts;       // [columns * rows + 1]
  const int64_t* slots;        // [pairs]
  int64_t columns, rows, side, width, height, depth, threads;
  double log_alpha_min, log_alpha_max, stop, least;
  T* features;                 // [height, width, depth]
  T* transmittance;            // [height, width]
  int64_t* median_index;       // [height, width], or null
  int32_t* ends;               // [height, width]: the place in the tile's list at which a pixel was
                               // finished; null: no gradient is wanted
  const T* grad_features;      // [height, width, depth]
  const T* grad_transmittance; // [height, width]
  const T* wanted;             // [height, width]: 0 where no light is let through; null: all
  T* gradients;                // [pairs, GEOMETRY + depth], by slot
};

// A block is BLOCK_WIDTH * BLOCK_HEIGHT pixels, one a lane, row by row; a cell is CELL * CELL
// pixels, block by block.
template <typename T>
struct Shape {
  static constexpr int BLOCK_WIDTH = LANES<T> >= 8 ? 4 : 2;
  static constexpr int BLOCK_HEIGHT = LANES<T> / BLOCK_WIDTH;
  static constexpr int CELL = LANES<T> >= 4 ? 16 : 8;
  static constexpr int ACROSS = CELL / BLOCK_WIDTH;  // blocks
  static constexpr int BLOCKS = ACROSS * (CELL / BLOCK_HEIGHT), PIXELS = CELL * CELL;
  static_assert(BLOCKS <= 64, "one bit of a Mask each");

  static int place(int x, int y) {
    const int block = y / BLOCK_HEIGHT * ACROSS + x / BLOCK_WIDTH;
    return block * LANES<T> + y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH;
  }
  static int blocks_down(int pixels) { return (pixels + BLOCK_HEIGHT - 1) / BLOCK_HEIGHT; }
};

using Mask = uint64_t;  // a bit a block of a cell
inline int lowest(Mask mask) { return __builtin_ctzll(mask); }

// Part of a tile: the pixels from (left, top), `columns` by `rows` of them.
template <typename T>
struct Cell {
  const Job<T>& job;
  int64_t first, count;  // of the tile's list
  int64_t left, top;
  int columns, rows;
  T centre_x, centre_y;

  Cell(const Job<T>& job, int64_t tile, int64_t left, int64_t top, int64_t right, int64_t bottom)
      : job(job), first(job.starts[tile]), count(job.starts[tile + 1] - first),
        left(left), top(top),
        columns(int(std::min<int64_t>(Shape<T>::CELL, right - left))),
        rows(int(std::min<int64_t>(Shape<T>::CELL, bottom - top))),
        centre_x(T(left) + Shape<T>::CELL / 2), centre_y(T(top) + Shape<T>::CELL / 2) {}

  const T* row(int64_t i) const {
    return job.table + job.members[first + i] * (GEOMETRY + job.depth);
  }

  template <typename Work>
  void each_pixel(Work work) const {  // place in the cell, pixel of the picture
    for (int y = 0; y < rows; y++)
      for (int x = 0; x < columns; x++)
        work(Shape<T>::place(x, y), (top + y) * job.width + left + x);
  }
};

template <typename T>
struct Chunk {
  // At (x, y), from the cell's centre, alpha is 2^(c - u u - v v), u = w0 x + u0,
  // v = w1 x + w2 y + v0: w is the whitening factor times SCALE, (dx, dy) from the Gaussian to the
  // cell's centre. Nothing cancels in that.
  T dx[CHUNK], dy[CHUNK], w0[CHUNK], w1[CHUNK], w2[CHUNK], u0[CHUNK], v0[CHUNK], c[CHUNK];
  const T* features[CHUNK];
  Mask blocks[CHUNK];  // that the ellipse reaches
  static constexpr T SCALE = T(0.84932180028801904);  // sqrt(log2(e) / 2)

  // From place `start` of the cell's list on; `next` is where the chunk after this one will start.
  void fill(const Cell<T>& cell, int64_t start, int64_t next) {
    const int64_t last = cell.count - 1;
    T radius[CHUNK];
    for (int g = 0; g < CHUNK; g++) {
      const T* row = cell.row(std::min(start + g, last));
      dx[g] = row[0], dy[g] = row[1], w0[g] = row[2], w1[g] = row[3], w2[g] = row[4];
      c[g] = row[5], features[g] = row + GEOMETRY;
    }
    for (int64_t g = std::max<int64_t>(0, next); g < std::min(next + CHUNK, cell.count); g++) {
      const T* row = cell.row(g);
      __builtin_prefetch(row), __builtin_prefetch(row + GEOMETRY + cell.job.depth - 1);
    }
    const T floor = T(cell.job.log_alpha_min);
#pragma omp simd
    for (int g = 0; g < CHUNK; g++) {
      dx[g] = cell.centre_x - dx[g], dy[g] = cell.centre_y - dy[g];
      // rounding must never lose a block: a superset is harmless, each pixel tests its own alpha
      radius[g] = std::sqrt(std::max(T(0), 2 * (c[g] - floor))) * T(1.0005) + T(1e-3);
    }
    reach(cell.rows, radius);
#pragma omp simd
    for (int g = 0; g < CHUNK; g++) {
      w0[g] *= SCALE, w1[g] *= SCALE, w2[g] *= SCALE;
      u0[g] = w0[g] * dx[g], v0[g] = w1[g] * dx[g] + w2[g] * dy[g];
      c[g] *= T(1.4426950408889634);
    }
    for (int64_t g = last - start + 1; g < CHUNK; g++) blocks[g] = 0;
  }

 private:
  // A row of blocks at a time. In a row the ellipse's x is extreme at its own tip, or at the edge
  // nearest to that (see tiles.py). Where a number is not finite, all blocks are reached.
  void reach(int rows, const T* radius) {
    using S = Shape<T>;
    constexpr T HALF = S::CELL / 2, ACROSS = S::ACROSS;
    constexpr T ROUNDING = 8 * std::numeric_limits<T>::epsilon();
    T shear[CHUNK], across[CHUNK], fall[CHUNK], tip[CHUNK], height[CHUNK], slack[CHUNK];
#pragma omp simd
    for (int g = 0; g < CHUNK; g++) {
      const T a = w0[g] * w0[g] + w1[g] * w1[g];
      across[g] = 1 / std::sqrt(a);
      shear[g] = w1[g] * w2[g] / a;
      const T narrow = w0[g] * w2[g] * across[g];
      fall[g] = narrow * narrow;
      tip[g] = w1[g] * radius[g] / (w0[g] * w2[g]);
      height[g] = radius[g] / narrow * T(1.0001) + T(0.01) + ROUNDING * std::abs(dy[g]);
      slack[g] = T(0.01) + ROUNDING * (std::abs(dx[g]) + radius[g] * across[g]);
      blocks[g] = 0;
    }
    for (int row = 0; row < S::blocks_down(rows); row++) {
      const T top = T(row * S::BLOCK_HEIGHT) + T(0.5) - HALF;
#pragma omp simd
      for (int g = 0; g < CHUNK; g++) {
        const T low = top + dy[g], high = low + (S::BLOCK_HEIGHT - 1), h = height[g];
        const T r2 = radius[g] * radius[g], shift = HALF - T(0.5) - dx[g];
        const T right = std::min(std::max(std::min(std::max(-tip[g], low), high), -h), h);
        const T left = std::min(std::max(std::min(std::max(tip[g], low), high), -h), h);
        const T to = shift - shear[g] * right +
                     across[g] * std::sqrt(std::max(T(0), r2 - fall[g] * right * right));
        const T from = shift - shear[g] * left -
                       across[g] * std::sqrt(std::max(T(0), r2 - fall[g] * left * left));
        // the first pixel is the next one after `from`, the last the one before `to`
        const T begin = (from - slack[g] + T(0.999)) / S::BLOCK_WIDTH;
        const T end = (to + slack[g]) / S::BLOCK_WIDTH + 1;
        const int32_t b = int32_t(std::min(std::max(T(0), begin), ACROSS));
        const int32_t e = std::max(b, int32_t(std::max(std::min(ACROSS, end), T(0))));
        const int32_t bits = (1 << e) - (1 << b), outside = (low > h) | (high < -h);
        blocks[g] |= Mask(outside ? 0 : bits) << (row * S::ACROSS);
      }
    }
  }
};
