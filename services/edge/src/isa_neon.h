// The primitives of NEON; other dot products replace its own. Included by one source file per path.
#pragma once

#include <arm_neon.h>

#include "forward.h"

namespace bpn {
namespace {

struct Neon {
  static constexpr int kLanes = 4;
  static constexpr int kOutputs = 2;
  static constexpr int kPixelOffset = 0;
  using Pixels = uint8x16_t;
  using Signs = int16x8_t;
  using Sums = int32x4_t;
  struct Partial {  // int16: the 64 taps of a channel, of 255, are 16320 at most
    int16x8_t low, high;
  };
  struct Counts {
    uint64x2_t lanes[4];
  };

  static Pixels load(const uint8_t* pixels) { return vld1q_u8(pixels); }
  static Signs broadcast(uint32_t tap) { return vmovl_s8(vreinterpret_s8_u32(vdup_n_u32(tap))); }
  static Partial begin(Sums) { return {vdupq_n_s16(0), vdupq_n_s16(0)}; }
  static Partial dot(Partial partial, Pixels x, Signs w) {
    const int16x8_t low = vreinterpretq_s16_u16(vmovl_u8(vget_low_u8(x)));
    const int16x8_t high = vreinterpretq_s16_u16(vmovl_high_u8(x));
    return {vmlaq_s16(partial.low, low, w), vmlaq_s16(partial.high, high, w)};
  }
  static Sums end(Sums sums, Partial partial) {
    return vaddq_s32(sums, vpaddq_s32(vpaddlq_s16(partial.low), vpaddlq_s16(partial.high)));
  }

  static Sums mark_above(Sums bits, Sums sums, int32_t floor, int bit) {
    const int32x4_t above = vreinterpretq_s32_u32(vcgtq_s32(sums, vdupq_n_s32(floor)));
    return vorrq_s32(bits, vandq_s32(above, vdupq_n_s32(bit)));
  }
  static void store_bytes(uint8_t* out, Sums bits) {
    const uint16x4_t words = vmovn_u32(vreinterpretq_u32_s32(bits));
    const uint8x8_t bytes = vmovn_u16(vcombine_u16(words, words));
    std::memcpy(out, &bytes, kLanes);
  }

  static Counts count(Counts counts, uint64_t word, const WordBlock& weights) {
    for (int i = 0; i < 4; ++i) {
      const uint64x2_t differing = veorq_u64(vdupq_n_u64(word), vld1q_u64(weights.lane + 2 * i));
      const uint8x16_t bits = vcntq_u8(vreinterpretq_u8_u64(differing));
      counts.lanes[i] = vpadalq_u32(counts.lanes[i], vpaddlq_u16(vpaddlq_u8(bits)));
    }
    return counts;
  }
  static uint8_t at_most(Counts counts, const LimitBlock& limits) {
    int bits = 0;
    for (int i = 0; i < 4; ++i) {
      const uint64x2_t within = vcleq_s64(vreinterpretq_s64_u64(counts.lanes[i]), vld1q_s64(limits.lane + 2 * i));
      bits |= static_cast<int>((vgetq_lane_u64(within, 0) & 1) | (vgetq_lane_u64(within, 1) & 2)) << 2 * i;
    }
    return static_cast<uint8_t>(bits);
  }
  static void store(int64_t* out, Counts counts) {
    for (int i = 0; i < 4; ++i) vst1q_s64(out + 2 * i, vreinterpretq_s64_u64(counts.lanes[i]));
  }
};

}  // namespace
}  // namespace bpn
