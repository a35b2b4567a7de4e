#include "minibatch.h"

namespace bpn {
namespace {

bool always() { return true; }

#if defined(__x86_64__)
bool is_cascade_lake() {
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
         __builtin_cpu_supports("avx512vnni");
}
bool has_avx512_vnni() { return is_cascade_lake() && __builtin_cpu_supports("avx512vpopcntdq"); }
bool has_avx2() { return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"); }
#endif

constexpr Path kPaths[] = {
#if defined(__x86_64__)
    {"avx512-vnni", has_avx512_vnni, gradients_avx512_vnni, float_gradients_avx512_vnni},
    {"cascade-lake", is_cascade_lake, gradients_cascade_lake, float_gradients_cascade_lake},
    {"avx2", has_avx2, gradients_avx2, float_gradients_avx2},
#endif
    {"portable", always, gradients_portable, float_gradients_portable},
};

}  // namespace

PathList compiled_paths() { return {kPaths, sizeof(kPaths) / sizeof(kPaths[0])}; }

}  // namespace bpn
