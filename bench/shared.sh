# Sourced by the benchmarks, in the root of the checkout: `shared` becomes the folder of reference data, as an absolute path, `target` what cargo builds into.
# DEPTHLOOM_SHARED names it, absolute or from the root of the checkout, as it does for the tests; by default it lies beside the checkout.
shared=${DEPTHLOOM_SHARED:-../shared}
case "$shared" in
    /*) ;;
    *) shared=$PWD/$shared ;;
esac
target=${CARGO_TARGET_DIR:-$PWD/target}

# peer NAME MODULES PACKAGE...: `venv` becomes the virtual environment NAME under target/, which has the packages; they are installed where the modules cannot be
# imported.
peer() {
    venv=$target/$1
    local modules=$2
    shift 2
    if ! "$venv/bin/python" -c "import $modules" 2>/dev/null; then
        python3 -m venv "$venv"
        "$venv/bin/pip" install --quiet "$@"
    fi
}
