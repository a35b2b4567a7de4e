// Signs as bits (1: +1), and the outputs of layers whose inputs and weights are signs: o = inputs - 2 (differing bits),
// exact.
#pragma once

#include "geometry.h"
#include "vectors.h"

namespace bpn {
namespace {

using Eight = float __attribute__((vector_size(32)));
using EightInts = int32_t __attribute__((vector_size(32)));
using EightWords = uint64_t __attribute__((vector_size(64)));

// Bit i is set where value i is not negative; NaN is.
inline uint8_t sign_bits(Eight values) {
#if defined(__AVX512VL__)
  return _mm256_cmp_ps_mask((__m256)values, _mm256_setzero_ps(), _CMP_GE_OQ);
#elif defined(__AVX2__)
  return static_cast<uint8_t>(_mm256_movemask_ps((__m256)(values >= 0)));
#else
  int bits = 0;
  for (int i = 0; i < 8; ++i) bits |= (values[i] >= 0) << i;
  return static_cast<uint8_t>(bits);
#endif
}

static_assert(kBlock == 16);
inline uint16_t block_sign_bits(const float* values) {
#if defined(__AVX512F__)
  return _mm512_cmp_ps_mask(loaded<__m512>(values), _mm512_setzero_ps(), _CMP_GE_OQ);
#else
  return static_cast<uint16_t>(sign_bits(loaded<Eight>(values)) | sign_bits(loaded<Eight>(values + 8)) << 8);
#endif
}

// How many bits are set in each word.
inline EightWords counted(EightWords x) {
#if defined(__AVX512VPOPCNTDQ__)
  return (EightWords)_mm512_popcnt_epi64((__m512i)x);
#elif defined(__AVX512BW__)
  const __m512i table = _mm512_broadcast_i32x4(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
  const __m512i nibble = _mm512_set1_epi8(15);
  const __m512i low = _mm512_shuffle_epi8(table, _mm512_and_si512((__m512i)x, nibble));
  const __m512i high = _mm512_shuffle_epi8(table, _mm512_and_si512(_mm512_srli_epi16((__m512i)x, 4), nibble));
  return (EightWords)_mm512_sad_epu8(_mm512_add_epi8(low, high), _mm512_setzero_si512());
#elif defined(__AVX2__)  // and so with a popcount of its own, which Clang and GCC take for one word at a time
  for (int i = 0; i < 8; ++i) x[i] = __builtin_popcountll(x[i]);
  return x;
#else
  constexpr uint64_t kBytes = 0x0101010101010101;
  x -= x >> 1 & 0x55 * kBytes;
  x = (x & 0x33 * kBytes) + (x >> 2 & 0x33 * kBytes);
  x = (x + (x >> 4)) & 0x0f * kBytes;
  x += x >> 8, x += x >> 16, x += x >> 32;
  return x & 0x7f;
#endif
}

// The weights' signs [width][fan_in], where what pads a patch is 0, as bits [eight outputs][word of a patch][output].
inline void pack_signs(const Layer& l, const float* signs, uint64_t* bits) {
  for (int n = 0; n < l.outputs; ++n) {
    uint64_t* to = bits + size_t(n / 8) * l.patch_words() * 8 + n % 8;
    for (int i = 0; i < l.rows; ++i)
      for (int first = 0; first < l.run; first += 64, to += 8) {
        const float* from = signs + size_t(n) * l.fan_in() + i * l.run + first;
        uint64_t word = 0;
        for (int k = 0; k < 64 && first + k < l.run; k += kBlock) word |= uint64_t{block_sign_bits(from + k)} << k;
        *to = word;
      }
  }
}

// Outputs at every position of every image. Words: of a patch, or 0: more than are worth a loop of their own. The layer
// is passed by value: floats that are stored could otherwise be its sizes, for all that a compiler knows.
template <int Words>
inline void count_outputs_of(const Layer l, int images, const uint8_t* x, const uint64_t* signs, float* o) {
  constexpr int kMaxWords = kMaxKernel * kMaxKernel * kMaxConvolutionChannels / 64;
  const int words = Words ? Words : l.patch_words(), row_words = l.row_words(), tail = l.run % 64;
  const int size = l.size, width = l.width, bytes = l.bit_bytes(), fan_in = l.true_fan_in();
  const int row_bytes = l.row_stride / 8, step_y = l.step_y / 8, step_x = l.step_x / 8;
  const uint64_t last = tail ? (uint64_t{1} << tail) - 1 : ~uint64_t{0};
  uint64_t copy[Words ? Words : kMaxWords];
  for (int b = 0; b < images; ++b, x += bytes)
    for (int y = 0; y < size; ++y)
      for (int column = 0; column < size; ++column, o += width) {
        const uint8_t* patch = x + y * step_y + column * step_x;
        if (!l.connected) {
          for (int w = 0, i = 0; w < words; ++i, patch += row_bytes)
            for (int j = 0; j < row_words; ++j, ++w)
              copy[w] = loaded<uint64_t>(patch + 8 * j) & (j + 1 == row_words ? last : ~uint64_t{0});
          patch = reinterpret_cast<const uint8_t*>(copy);
        }
        const uint64_t* of_block = signs;
        for (int first = 0; first < width; first += 8) {
          EightWords differing = {};
          for (int w = 0; w < words; ++w, of_block += 8)
            differing += counted(loaded<EightWords>(of_block) ^ loaded<uint64_t>(patch + 8 * w));
          const EightInts sums = fan_in - 2 * __builtin_convertvector(differing, EightInts);
          const EightInts outputs = first + EightInts{0, 1, 2, 3, 4, 5, 6, 7} < l.outputs;  // and not padding
          store(o + first, __builtin_convertvector(sums & outputs, Eight));
        }
      }
}

// From bits [image][position][in_width / 8], an image's in whole words that end with zeros. What pads a patch's inputs
// and weights is 1 in both, and no difference.
inline void count_outputs(const Layer& l, int images, const uint8_t* x, const uint64_t* signs, float* o) {
  const bool by_rows = !l.connected && l.row_words() == 1;
  if (by_rows && l.rows == 4)
    count_outputs_of<4>(l, images, x, signs, o);  // the paper's conv2
  else if (by_rows && l.rows == 3)
    count_outputs_of<3>(l, images, x, signs, o);  // and conv3
  else
    count_outputs_of<0>(l, images, x, signs, o);
}

}  // namespace
}  // namespace bpn
