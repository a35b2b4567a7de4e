#!/bin/sh
# Builds both C++ kernels with the address and undefined-behaviour sanitizers, beside the installed ones, and runs
# their exactness tests and changed weights through them. The first report ends the test process.
set -eu
python=$1
bin=$(dirname "$python")
build=build/sanitized
mkdir -p "$build"
flags="-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer -g1"
for service in edge learner; do
  PATH="$PWD/$bin:$PATH" cmake -S "services/$service" -B "$build/$service" -G Ninja -Wno-dev \
    -DCMAKE_BUILD_TYPE=None -DCMAKE_CXX_FLAGS="$flags" -DPython_EXECUTABLE="$PWD/$python" \
    -Dnanobind_DIR="$("$python" -m nanobind --cmake_dir)" > "$build/$service.log" 2>&1 \
    || { cat "$build/$service.log"; exit 1; }
  PATH="$PWD/$bin:$PATH" cmake --build "$build/$service" -- --quiet
done
# The sanitizer must be there before Python is; libstdc++ too, or exceptions cannot be followed. Python keeps what
# it has until its end, which is no leak of ours.
export LD_PRELOAD="$(g++ -print-file-name=libasan.so):$(g++ -print-file-name=libstdc++.so.6)"
export ASAN_OPTIONS=detect_leaks=0:abort_on_error=1 UBSAN_OPTIONS=print_stacktrace=1
export BPN_SANITIZED="$build" PYTHONPATH=tests/support
exec "$python" -m pytest -p sanitized -q \
  tests/unit/edge/test_kernel_exactness.py tests/unit/edge/test_kernel_errors.py \
  tests/unit/learner/test_minibatch.py "tests/security/test_decoders.py" -k "not decoders or weights"
