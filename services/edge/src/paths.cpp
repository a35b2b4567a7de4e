#include "paths.h"

namespace bpn {
namespace {

bool always() { return true; }

#if defined(__x86_64__)
bool has_avx512_vnni() {
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512vnni") &&
         __builtin_cpu_supports("avx512vpopcntdq");
}
bool has_avx_vnni() {
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("avxvnni");
}
bool has_avx2() { return __builtin_cpu_supports("avx2"); }
#endif

constexpr Path kPaths[] = {
#if defined(__x86_64__)
    {"avx512-vnni", has_avx512_vnni, paper_avx512_vnni, any_avx512_vnni},
    {"avx-vnni", has_avx_vnni, paper_avx_vnni, any_avx_vnni},
    {"avx2", has_avx2, paper_avx2, any_avx2},
#elif defined(__aarch64__)
    {"neon", always, paper_neon, any_neon},
#endif
    {"portable", always, any_portable, any_portable},
};

}  // namespace

PathList compiled_paths() { return {kPaths, sizeof(kPaths) / sizeof(kPaths[0])}; }

}  // namespace bpn
