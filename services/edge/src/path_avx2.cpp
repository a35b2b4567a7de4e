// AVX2: nearly every x86-64 machine since 2013.
#include "isa_avx2.h"

namespace bpn {

void forward_avx2(const PackedNetwork& network, const uint8_t* observation, Activations& out) {
  forward<Avx2>(network, observation, out);
}

}  // namespace bpn
