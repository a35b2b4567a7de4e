// The primitives of AVX2; AVX-VNNI replaces the dot product. Included by one source file per path.
#pragma once

#include <immintrin.h>

#include "forward.h"

namespace bpn {
namespace {

struct Avx2 {
  static constexpr int kLanes = 8;
  static constexpr int kOutputs = 2;  // 5 x 2 sums in 16 registers
  static constexpr int kPixelOffset = 0;
  using Pixels = __m256i;
  using Signs = __m256i;
  using Sums = __m256i;
  using Partial = __m256i;  // int16 pairs: the 64 taps of a channel, of 2 x 255, are 32640 at most
  struct Counts {
    __m256i low, high;
  };

  static __m256i load_aligned(const void* data) { return _mm256_load_si256(static_cast<const __m256i*>(data)); }
  static Pixels load(const uint8_t* pixels) { return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(pixels)); }
  static Signs broadcast(uint32_t tap) { return _mm256_set1_epi32(static_cast<int>(tap)); }
  static Partial begin(Sums) { return _mm256_setzero_si256(); }
  static Partial dot(Partial pairs, Pixels x, Signs w) { return _mm256_add_epi16(pairs, _mm256_maddubs_epi16(x, w)); }
  static Sums end(Sums sums, Partial pairs) {
    return _mm256_add_epi32(sums, _mm256_madd_epi16(pairs, _mm256_set1_epi16(1)));
  }

  static Sums mark_above(Sums bits, Sums sums, int32_t floor, int bit) {
    const __m256i above = _mm256_cmpgt_epi32(sums, _mm256_set1_epi32(floor));
    return _mm256_or_si256(bits, _mm256_and_si256(above, _mm256_set1_epi32(bit)));
  }
  static void store_bytes(uint8_t* out, Sums bits) {
    const __m128i words = _mm_packus_epi32(_mm256_castsi256_si128(bits), _mm256_extracti128_si256(bits, 1));
    _mm_storel_epi64(reinterpret_cast<__m128i*>(out), _mm_packus_epi16(words, words));
  }

  // Bits in each 64-bit lane, by table lookup of the nibbles.
  static __m256i popcount(__m256i x) {
    const __m256i table = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
    const __m256i nibble = _mm256_set1_epi8(15);
    const __m256i low = _mm256_shuffle_epi8(table, _mm256_and_si256(x, nibble));
    const __m256i high = _mm256_shuffle_epi8(table, _mm256_and_si256(_mm256_srli_epi16(x, 4), nibble));
    return _mm256_sad_epu8(_mm256_add_epi8(low, high), _mm256_setzero_si256());
  }
  static Counts count(Counts counts, uint64_t word, const WordBlock& weights) {
    const __m256i x = _mm256_set1_epi64x(static_cast<int64_t>(word));
    const __m256i low = _mm256_xor_si256(x, load_aligned(weights.lane));
    const __m256i high = _mm256_xor_si256(x, load_aligned(weights.lane + 4));
    return {_mm256_add_epi64(counts.low, popcount(low)), _mm256_add_epi64(counts.high, popcount(high))};
  }
  static int lanes_above(__m256i counts, __m256i limits) {
    return _mm256_movemask_pd(_mm256_castsi256_pd(_mm256_cmpgt_epi64(counts, limits)));
  }
  static uint8_t at_most(Counts counts, const LimitBlock& limits) {
    const int above = lanes_above(counts.low, load_aligned(limits.lane)) |
                      lanes_above(counts.high, load_aligned(limits.lane + 4)) << 4;
    return static_cast<uint8_t>(~above);
  }
  static void store(int64_t* out, Counts counts) {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), counts.low);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + 4), counts.high);
  }
};

}  // namespace
}  // namespace bpn
