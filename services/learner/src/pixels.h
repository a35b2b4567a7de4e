// conv1's outputs: unsigned bytes times signs, eight inputs of one kernel row at a time, exact.
#pragma once

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include <cstddef>

#include "geometry.h"
#include "vectors.h"

namespace bpn {
namespace {

// Sums of eight outputs. `add` takes eight neighbouring pixels and their signs [output][input].
#if defined(__AVX512VNNI__)
constexpr int kColumns = 10;  // positions at a time; divides the paper's 20
struct Sums {
  __m512i pairs = _mm512_setzero_si512();  // two sums of four products for each output

  void add(const uint8_t* pixels, const int8_t* signs) {
    const __m512i x = _mm512_set1_epi64(loaded<int64_t>(pixels));
    pairs = _mm512_dpbusd_epi32(pairs, x, _mm512_loadu_si512(signs));
  }
  void store_to(float* o) {
    const __m256i even = _mm512_cvtepi64_epi32(pairs);
    const __m256i odd = _mm512_cvtepi64_epi32(_mm512_srli_epi64(pairs, 32));
    _mm256_storeu_ps(o, _mm256_cvtepi32_ps(_mm256_add_epi32(even, odd)));
  }
};
#elif defined(__AVX2__)
constexpr int kColumns = 4;
struct Sums {
  __m256i low = _mm256_setzero_si256(), high = _mm256_setzero_si256();

  static __m256i dot(__m256i x, const int8_t* signs) {  // |two products| <= 510: no saturation
    const __m256i w = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(signs));
    return _mm256_madd_epi16(_mm256_maddubs_epi16(x, w), _mm256_set1_epi16(1));
  }
  void add(const uint8_t* pixels, const int8_t* signs) {
    const __m256i x = _mm256_set1_epi64x(loaded<int64_t>(pixels));
    low = _mm256_add_epi32(low, dot(x, signs));
    high = _mm256_add_epi32(high, dot(x, signs + 32));
  }
  void store_to(float* o) {
    const __m256i mixed = _mm256_hadd_epi32(low, high);
    _mm256_storeu_ps(o, _mm256_cvtepi32_ps(_mm256_permute4x64_epi64(mixed, 0xd8)));
  }
};
#else
constexpr int kColumns = 1;
struct Sums {
  using Shorts = int16_t __attribute__((vector_size(16)));
  using Pixels = uint8_t __attribute__((vector_size(8)));
  using Signs = int8_t __attribute__((vector_size(8)));
  static constexpr int kMost = 32767 / kMaxPixel;  // products that fit a lane
  Shorts lanes[kTogetherOutputs] = {};
  int sums[kTogetherOutputs] = {}, added = 0;

  void add(const uint8_t* pixels, const int8_t* signs) {
    if (added++ == kMost) empty(), added = 1;
    const Shorts x = __builtin_convertvector(loaded<Pixels>(pixels), Shorts);
    for (int n = 0; n < kTogetherOutputs; ++n)
      lanes[n] += x * __builtin_convertvector(loaded<Signs>(signs + 8 * n), Shorts);
  }
  void empty() {
    for (int n = 0; n < kTogetherOutputs; ++n) {
      for (int i = 0; i < 8; ++i) sums[n] += lanes[n][i];
      lanes[n] = Shorts{};
    }
  }
  void store_to(float* o) {
    empty();
    for (int n = 0; n < kTogetherOutputs; ++n) o[n] = static_cast<float>(sums[n]);
  }
};
#endif

// Eight outputs at so many neighbouring positions. A pointer to every third one, from which the next two are one and
// two steps away, leaves room for all of them in registers. `extents` are those of the patch's rows, `first` is where
// in them it begins.
template <int Columns>
[[gnu::noinline]] void convolve_pixels_at(const Layer& l, const uint8_t* patch, const Extent* extents, int first,
                                          const int8_t* w, float* o) {
  constexpr int kPointers = (Columns + 2) / 3;
  const ptrdiff_t step = l.step_x, row_stride = l.row_stride;
  const int rows = l.rows, run = l.run;
  const int groups = (run + kTogetherPixels - 1) / kTogetherPixels;
  const int end = first + static_cast<int>((Columns - 1) * step) + run;
  Sums sums[Columns];
  for (int i = 0; i < rows; ++i, patch += row_stride) {
    if (first >= extents[i].end || end <= extents[i].begin) {
      w += groups * kTogetherPixels * kTogetherOutputs;
      continue;
    }
    const uint8_t* at[kPointers];
    for (int p = 0; p < kPointers; ++p) at[p] = patch + 3 * p * step;
    for (int k = 0; k < run; k += kTogetherPixels, w += kTogetherPixels * kTogetherOutputs) {
      for (int c = 0; c < Columns; ++c) sums[c].add(at[c / 3] + c % 3 * step, w);
      for (int p = 0; p < kPointers; ++p) {
        at[p] += kTogetherPixels;
        asm("" : "+r"(at[p]));  // or each position gets a pointer again
      }
    }
  }
  for (int c = 0; c < Columns; ++c) sums[c].store_to(o + c * l.width);
}

// One of `parts` pieces of an image that is needed soon, and lies anywhere in D: beyond all caches.
inline void fetch_ahead(const Layer& l, const uint8_t* image, int part, int parts) {
  constexpr int kCacheLine = 64;
  const int begin = static_cast<int>(int64_t{l.image} * part / parts);
  const int end = static_cast<int>(int64_t{l.image} * (part + 1) / parts);
  for (int i = begin; i < end; i += kCacheLine) __builtin_prefetch(image + i);
}

// `extents` are those of the image's rows. `next` is the image after this one, or null; it is fetched meanwhile.
inline void convolve_pixels(const Layer& l, const uint8_t* image, const Extent* extents, const uint8_t* next,
                            const int8_t* signs, float* o) {
  const int groups = (l.run + kTogetherPixels - 1) / kTogetherPixels;
  const int block = l.rows * groups * kTogetherPixels * kTogetherOutputs;
  for (int first = 0; first < l.width; first += kTogetherOutputs, signs += block)
    for (int y = 0; y < l.size; ++y) {
      if (next && first == 0) fetch_ahead(l, next, y, l.size);
      for (int x = 0; x < l.size;) {
        const uint8_t* patch = image + y * l.step_y + x * l.step_x;
        float* to = o + (y * l.size + x) * l.width + first;
        const bool many = l.size - x >= kColumns;
        const Extent* own = extents + y * l.stride();
        if (many)
          convolve_pixels_at<kColumns>(l, patch, own, x * l.step_x, signs, to);
        else
          convolve_pixels_at<1>(l, patch, own, x * l.step_x, signs, to);
        x += many ? kColumns : 1;
      }
    }
}

}  // namespace
}  // namespace bpn
