#include "paths.h"

#include <cstring>

#if !defined(BPN_PORTABLE) && defined(__x86_64__)
#define BPN_X86_64
#elif !defined(BPN_PORTABLE) && defined(__aarch64__)
#define BPN_AARCH64
#endif
#if defined(BPN_AARCH64) && defined(__linux__)
#include <asm/hwcap.h>
#include <sys/auxv.h>
#endif

namespace bpn {
namespace {

bool always() { return true; }

#if defined(BPN_X86_64)
bool has_avx512_vnni() {
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512vnni") &&
         __builtin_cpu_supports("avx512vpopcntdq");
}
bool has_avx_vnni() { return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("avxvnni"); }
bool has_avx2() { return __builtin_cpu_supports("avx2"); }
#elif defined(BPN_AARCH64) && defined(__linux__)
bool has_neon_dot() { return getauxval(AT_HWCAP) & HWCAP_ASIMDDP; }
bool has_neon_i8mm() { return has_neon_dot() && getauxval(AT_HWCAP2) & HWCAP2_I8MM; }
#elif defined(BPN_AARCH64)
bool has_neon_dot() { return false; }
bool has_neon_i8mm() { return false; }
#endif

constexpr Path kPaths[] = {
#if defined(BPN_X86_64)
    {"avx512-vnni", has_avx512_vnni, paper_avx512_vnni, any_avx512_vnni},
    {"avx-vnni", has_avx_vnni, paper_avx_vnni, any_avx_vnni},
    {"avx2", has_avx2, paper_avx2, any_avx2},
#elif defined(BPN_AARCH64)
    {"neon-i8mm", has_neon_i8mm, paper_neon_i8mm, any_neon_i8mm},
    {"neon-dot", has_neon_dot, paper_neon_dot, any_neon_dot},
    {"neon", always, paper_neon, any_neon},
#endif
    {"portable", always, any_portable, any_portable},
};

}  // namespace

const Path* find_path(const char* name) {
  for (const Path& path : kPaths)
    if ((!name || std::strcmp(name, path.name) == 0) && path.supported()) return &path;
  return nullptr;
}

PathList compiled_paths() { return {kPaths, sizeof(kPaths) / sizeof(kPaths[0])}; }

}  // namespace bpn
