// What every machine of the architecture has: SSE2, NEON.
#include "float_gradients.h"
#include "gradients.h"

namespace bpn {

void gradients_portable(const Geometry& geometry, const Batch& batch, const Parameters& in, const Workspace& work,
                        Gradients& out) {
  gradients(geometry, batch, in, work, out);
}

void float_gradients_portable(const Geometry& geometry, const Batch& batch, const FloatParameters& in,
                              const Workspace& work, FloatGradients& out) {
  float_gradients(geometry, batch, in, work, out);
}

}  // namespace bpn
