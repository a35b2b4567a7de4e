// AVX-512 with VNNI and VPOPCNTDQ: Intel since Ice Lake, AMD since Zen 4.
#include "float_gradients.h"
#include "gradients.h"

namespace bpn {

void gradients_avx512_vnni(const Geometry& geometry, const Batch& batch, const Parameters& in, const Workspace& work,
                           Gradients& out) {
  gradients(geometry, batch, in, work, out);
}

void float_gradients_avx512_vnni(const Geometry& geometry, const Batch& batch, const FloatParameters& in,
                                 const Workspace& work, FloatGradients& out) {
  float_gradients(geometry, batch, in, work, out);
}

}  // namespace bpn
