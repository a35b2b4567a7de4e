// AVX-512 with VNNI (vpdpbusd) and VPOPCNTDQ: Intel since Ice Lake, AMD since Zen 4.
#include <immintrin.h>

#include "conv1_rows.h"
#include "forward.h"

namespace bpn {
namespace {

struct Avx512Vnni {
  static constexpr int kLanes = 16;
  static constexpr int kOutputs = 4;  // 5 x 4 sums and 5 vectors of pixels in 32 registers
  static constexpr int kPixelOffset = 0;
  using Pixels = __m512i;
  using Signs = __m512i;
  using Sums = __m512i;
  using Partial = __m512i;
  using Counts = __m512i;

  static Pixels load(const uint8_t* pixels) { return _mm512_loadu_si512(pixels); }
  static Pixels load_tails(const uint8_t* pixels) {
    constexpr int kStep = kConv1Stride * kImagePx;
    const auto part = [](const uint8_t* from) { return _mm_loadu_si128(reinterpret_cast<const __m128i*>(from)); };
    const __m256i low = _mm256_setr_m128i(part(pixels), part(pixels + kStep));
    const __m256i high = _mm256_setr_m128i(part(pixels + 2 * kStep), part(pixels + 3 * kStep));
    return _mm512_inserti64x4(_mm512_castsi256_si512(low), high, 1);
  }
  static Signs broadcast(uint32_t tap) { return _mm512_set1_epi32(static_cast<int>(tap)); }
  static Partial begin(Sums sums) { return sums; }
  static Partial dot(Partial sums, Pixels x, Signs w) { return _mm512_dpbusd_epi32(sums, x, w); }
  // GCC copies the sums of the intrinsic, and runs out of registers.
  static void add_dot(Sums& sums, Pixels x, Signs w) { asm("vpdpbusd %2, %1, %0" : "+v"(sums) : "v"(x), "v"(w)); }
  static Sums end(Sums, Partial sums) { return sums; }

  static Sums mark_above(Sums bits, Sums sums, int32_t floor, int bit) {
    const __mmask16 above = _mm512_cmpgt_epi32_mask(sums, _mm512_set1_epi32(floor));
    return _mm512_mask_or_epi32(bits, above, bits, _mm512_set1_epi32(bit));
  }
  static void store_bytes(uint8_t* out, Sums bits) {
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out), _mm512_cvtepi32_epi8(bits));
  }

  static Counts count(Counts counts, uint64_t word, const WordBlock& weights) {
    const __m512i x = _mm512_set1_epi64(static_cast<int64_t>(word));
    const __m512i differing = _mm512_xor_si512(x, _mm512_load_si512(weights.lane));
    return _mm512_add_epi64(counts, _mm512_popcnt_epi64(differing));
  }
  static uint8_t at_most(Counts counts, const LimitBlock& limits) {
    return _mm512_cmple_epi64_mask(counts, _mm512_load_si512(limits.lane));
  }
  static void store(int64_t* out, Counts counts) { _mm512_storeu_si512(out, counts); }
};

}  // namespace

void paper_avx512_vnni(const Layers& network, const uint8_t* observation, const Activations& out) {
  conv1_by_rows<Avx512Vnni>(network.first, observation, out.maps[0]);
  paper_bit_layers<Avx512Vnni>(network, out);
}

void any_avx512_vnni(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_any<Avx512Vnni>(network, observation, out);
}

}  // namespace bpn
