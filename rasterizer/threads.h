// Work over threads: torch's where OpenMP runs them, else new ones.
//
// OpenMP's threads spin for milliseconds after an operation of torch; threads beside them would have
// to share their cores. compiled.py passes the entry point of the library that torch uses.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

// GOMP_parallel of libgomp: calls a function with its data on so many threads, of which the caller
// is one, and returns when all have.
using Team = void (*)(void (*)(void*), void*, unsigned, unsigned);
static Team team = nullptr;

extern "C" __attribute__((used, visibility("default"))) inline void use_team(Team found) {
  team = found;
}

// work(part) once for each part of [0, parts), at most so many at a time. False where one threw: an
// exception must not leave a library, Python would not see it.
template <typename Work>
bool over_threads(int64_t threads, int64_t parts, Work work) {
  std::atomic<int64_t> next{0};
  std::atomic<bool> good{true};
  auto loop = [&] {
    try {
      for (int64_t part; (part = next.fetch_add(1)) < parts;) work(part);
    } catch (...) {
      good = false;
    }
  };
  if (threads <= 1 || parts <= 1) {
    loop();
  } else if (team) {  // of its size whatever the work: OpenMP ends the threads that it does not need
    team([](void* data) { (*static_cast<decltype(loop)*>(data))(); }, &loop, unsigned(threads), 0);
  } else {
    std::vector<std::thread> others;
    try {
      for (int64_t i = 1; i < std::min(threads, parts); i++) others.emplace_back(loop);
    } catch (...) {
    }  // the threads that did start will do
    loop();
    for (auto& thread : others) thread.join();
  }
  return good;
}
