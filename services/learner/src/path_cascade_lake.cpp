// AVX-512 with VNNI alone: Intel's Cascade Lake and Cooper Lake. The bits are those of path_avx512_vnni.cpp, which
// counts differing bits in fewer instructions.
#include "float_gradients.h"
#include "gradients.h"

namespace bpn {

void gradients_cascade_lake(const Geometry& geometry, const Batch& batch, const Parameters& in, const Workspace& work,
                            Gradients& out) {
  gradients(geometry, batch, in, work, out);
}

void float_gradients_cascade_lake(const Geometry& geometry, const Batch& batch, const FloatParameters& in,
                                  const Workspace& work, FloatGradients& out) {
  float_gradients(geometry, batch, in, work, out);
}

}  // namespace bpn
