// AVX2 with AVX-VNNI: Intel's client processors since Alder Lake, which have no AVX-512.
#include "isa_avx2.h"

namespace bpn {
namespace {

struct AvxVnni : Avx2 {
  static Partial begin(Sums sums) { return sums; }
  static Partial dot(Partial sums, Pixels x, Signs w) { return _mm256_dpbusd_avx_epi32(sums, x, w); }
  static Sums end(Sums, Partial sums) { return sums; }
};

}  // namespace

void paper_avx_vnni(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_paper<AvxVnni>(network, observation, out);
}

void any_avx_vnni(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_any<AvxVnni>(network, observation, out);
}

}  // namespace bpn
