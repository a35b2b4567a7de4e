// AVX2 and FMA: nearly every x86-64 machine since 2013.
#include "float_gradients.h"
#include "gradients.h"

namespace bpn {

void gradients_avx2(const Geometry& geometry, const Batch& batch, const Parameters& in, const Workspace& work,
                    Gradients& out) {
  gradients(geometry, batch, in, work, out);
}

void float_gradients_avx2(const Geometry& geometry, const Batch& batch, const FloatParameters& in,
                          const Workspace& work, FloatGradients& out) {
  float_gradients(geometry, batch, in, work, out);
}

}  // namespace bpn
