// AVX-512 with VNNI: Intel since Ice Lake, AMD since Zen 4.
#include "gradients.h"

namespace bpn {

void gradients_avx512_vnni(const Geometry& geometry, const Batch& batch, const Parameters& in, const Workspace& work,
                  Gradients& out) {
  gradients(geometry, batch, in, work, out);
}

}  // namespace bpn
