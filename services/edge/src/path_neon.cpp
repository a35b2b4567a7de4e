// NEON, which every 64-bit ARM processor has.
#include "isa_neon.h"

namespace bpn {

void paper_neon(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_paper<Neon>(network, observation, out);
}

void any_neon(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_any<Neon>(network, observation, out);
}

}  // namespace bpn
