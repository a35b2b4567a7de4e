// NEON with dot products of unsigned with signed bytes (USDOT), part of I8MM: such as Neoverse V1 and N2, Cortex-A710.
#include "isa_neon.h"

namespace bpn {
namespace {

struct NeonI8mm : Neon {
  static constexpr int kOutputs = 4;  // 5 x 4 sums and 5 vectors of pixels in 32 registers
  using Signs = int8x16_t;
  using Partial = int32x4_t;

  static Signs broadcast(uint32_t tap) { return vreinterpretq_s8_u32(vdupq_n_u32(tap)); }
  static Partial begin(Sums sums) { return sums; }
  static Partial dot(Partial sums, Pixels x, Signs w) { return vusdotq_s32(sums, x, w); }
  static Sums end(Sums, Partial sums) { return sums; }
};

}  // namespace

void paper_neon_i8mm(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_paper<NeonI8mm>(network, observation, out);
}

void any_neon_i8mm(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_any<NeonI8mm>(network, observation, out);
}

}  // namespace bpn
