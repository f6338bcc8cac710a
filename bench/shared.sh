# Sourced by the benchmarks, in the root of the checkout: `shared` becomes the folder of reference data, as an absolute path, `target` what cargo builds into.
# DEPTHLOOM_SHARED names it, absolute or from the root of the checkout, as it does for the tests; by default it lies beside the checkout.
shared=${DEPTHLOOM_SHARED:-../shared}
case "$shared" in
    /*) ;;
    *) shared=$PWD/$shared ;;
esac
target=${CARGO_TARGET_DIR:-$PWD/target}
echo "processor: $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo 2>/dev/null | head -1), $(getconf _NPROCESSORS_ONLN) threads"
# The folder of our programs. Where DEPTHLOOM_BENCH_PROGRAMS names it, they are built already, and nothing is built: the tests do so.
programs=${DEPTHLOOM_BENCH_PROGRAMS:-$target/release}

# build ARGUMENT...: builds our programs, with these arguments of `cargo build`.
build() {
    if [ -z "${DEPTHLOOM_BENCH_PROGRAMS:-}" ]; then
        cargo build --release --quiet "$@"
    fi
}

# timed COMMAND...: runs a command, and sets `wall_s` to the seconds that its process took, from its start to its end, and `cpu_s` to the
# CPU time of all its threads.
timed() {
    local file TIMEFORMAT='%R %U %S'
    file=$(mktemp)
    { time "$@" 2>&3; } 3>&2 2>"$file"
    read -r wall_s cpu_s < <(awk '{ printf "%.3f %.3f\n", $1, $2 + $3 }' "$file")
    rm "$file"
}

# peer NAME MODULES PACKAGE...: `venv` becomes the virtual environment NAME under target/, which has the packages; they are installed where the modules cannot be
# imported. DEPTHLOOM_BENCH_VENV names another environment, which is expected to have them.
peer() {
    venv=${DEPTHLOOM_BENCH_VENV:-$target/$1}
    local modules=$2
    shift 2
    if ! "$venv/bin/python" -c "import $modules" 2>/dev/null; then
        python3 -m venv "$venv"
        "$venv/bin/pip" install --quiet "$@"
    fi
}
