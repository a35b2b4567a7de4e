// Vectors as wide as the path's registers, and how many of them its loops keep in registers.
// Included by the path files alone; everything is theirs (unnamed namespace).
#pragma once

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include <cstdint>
#include <cstring>
#include <utility>

#define INLINE_LAMBDA __attribute__((always_inline))

namespace bpn {
namespace {

#if defined(__AVX512F__)
constexpr int kLanes = 16, kRows = 8, kOutputVectors = 1;  // 32 registers
#elif defined(__AVX2__)
constexpr int kLanes = 8, kRows = 4, kOutputVectors = 2;
#else
constexpr int kLanes = 4, kRows = 4, kOutputVectors = 2;
#endif
constexpr int kMaxVectors = 3;

using Floats = float __attribute__((vector_size(4 * kLanes)));

template <class Vector>
inline Vector loaded(const void* from) {
  Vector v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
inline Floats load(const float* from) { return loaded<Floats>(from); }
inline Floats load(const uint8_t* from) {
#if defined(__AVX512F__)
  return (Floats)_mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(loaded<__m128i>(from)));
#elif defined(__AVX2__)
  return (Floats)_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(loaded<int64_t>(from))));
#else
  using Bytes = uint8_t __attribute__((vector_size(kLanes)));
  using Ints = int32_t __attribute__((vector_size(4 * kLanes)));
  return __builtin_convertvector(__builtin_convertvector(loaded<Bytes>(from), Ints), Floats);
#endif
}
template <class Vector, class Value>
inline void store(Value* to, Vector v) {
  std::memcpy(to, &v, sizeof v);
}

// Calls f(integral_constant<int, i>) for i = 0..N-1, unrolled in the source: sums that are indexed by it
// live in registers, where a loop over them leaves some in memory.
template <int... I, class F>
[[gnu::always_inline]] inline void each(std::integer_sequence<int, I...>, F&& f) {
  (f(std::integral_constant<int, I>{}), ...);
}
template <int N, class F>
[[gnu::always_inline]] inline void each(F&& f) {
  each(std::make_integer_sequence<int, N>{}, f);
}

// Calls f<V>(first) for `count` vectors in groups of V <= kMaxVectors.
template <class F>
inline void in_groups(int count, F&& f) {
  int first = 0;
  for (; count - first >= kMaxVectors; first += kMaxVectors) f.template operator()<kMaxVectors>(first);
  if (count - first == 2) f.template operator()<2>(first);
  if (count - first == 1) f.template operator()<1>(first);
}

}  // namespace
}  // namespace bpn
