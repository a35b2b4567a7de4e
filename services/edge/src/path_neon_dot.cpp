// NEON with dot products of signed bytes (SDOT): ARMv8.2 and later, such as Cortex-A55 and Cortex-A76.
#include "isa_neon.h"

namespace bpn {
namespace {

// Pixels less 128 are signed.
struct NeonDot : Neon {
  static constexpr int kOutputs = 4;  // 5 x 4 sums and 5 vectors of pixels in 32 registers
  static constexpr int kPixelOffset = 128;
  using Pixels = int8x16_t;
  using Signs = int8x16_t;
  using Partial = int32x4_t;

  static Pixels load(const uint8_t* pixels) {
    return vreinterpretq_s8_u8(veorq_u8(vld1q_u8(pixels), vdupq_n_u8(kPixelOffset)));
  }
  static Signs broadcast(uint32_t tap) { return vreinterpretq_s8_u32(vdupq_n_u32(tap)); }
  static Partial begin(Sums sums) { return sums; }
  static Partial dot(Partial sums, Pixels x, Signs w) { return vdotq_s32(sums, x, w); }
  static Sums end(Sums, Partial sums) { return sums; }
};

}  // namespace

void paper_neon_dot(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_paper<NeonDot>(network, observation, out);
}

void any_neon_dot(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_any<NeonDot>(network, observation, out);
}

}  // namespace bpn
