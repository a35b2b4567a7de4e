// Where pictures are not black. Simulated ones mostly are, and products with 0 change no sum.
#pragma once

#include <type_traits>

#include "minibatch.h"
#include "vectors.h"

namespace bpn {
namespace {

inline bool are_64_black(const uint8_t* pixels) {
#if defined(__AVX512F__)
  const __m512i all = _mm512_loadu_si512(pixels);
  return _mm512_test_epi64_mask(all, all) == 0;
#else
  uint64_t any = 0;
  for (int i = 0; i < 64; i += 8) any |= loaded<uint64_t>(pixels + i);
  return any == 0;
#endif
}

// Of a row of so many bytes, to whole eights.
inline Extent extent_of(const uint8_t* row, int bytes) {
  const auto are_8_black = [&](int at) { return loaded<uint64_t>(row + at) == 0; };
  int begin = 0, end = bytes;
  while (begin + 64 <= end && are_64_black(row + begin)) begin += 64;
  while (begin + 8 <= end && are_8_black(begin)) begin += 8;
  while (end - 64 >= begin && are_64_black(row + end - 64)) end -= 64;
  while (end - 8 >= begin && are_8_black(end - 8)) end -= 8;
  return {begin, end};
}

// Of every row of an image that conv1 reads.
inline void take_extents(const Layer& conv1, const uint8_t* image, Extent* extents) {
  for (int row = 0; row < conv1.in_rows(); ++row, image += conv1.row_stride)
    extents[row] = extent_of(image, conv1.row_stride);
}

// Whether V vectors of pixels are black.
template <int V>
inline bool are_black(const uint8_t* pixels) {
#if defined(__AVX512F__)
  __m128i all = loaded<__m128i>(pixels);
  for (int v = 1; v < V; ++v) all = _mm_or_si128(all, loaded<__m128i>(pixels + v * kLanes));
  return _mm_testz_si128(all, all);
#else
  using Word = std::conditional_t<kLanes == 8, uint64_t, uint32_t>;
  static_assert(sizeof(Word) == kLanes);
  Word all = 0;
  for (int v = 0; v < V; ++v) all |= loaded<Word>(pixels + v * kLanes);
  return all == 0;
#endif
}
template <int V>
inline bool are_black(const float*) {
  return false;
}

}  // namespace
}  // namespace bpn
