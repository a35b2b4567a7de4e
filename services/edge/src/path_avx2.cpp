// AVX2: nearly every x86-64 machine since 2013.
#include "isa_avx2.h"

namespace bpn {

void paper_avx2(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_paper<Avx2>(network, observation, out);
}

void any_avx2(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_any<Avx2>(network, observation, out);
}

}  // namespace bpn
