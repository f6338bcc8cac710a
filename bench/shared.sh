# Sourced by the benchmarks, in the root of the checkout: `shared` becomes the folder of reference data, as an absolute path.
# DEPTHLOOM_SHARED names it, absolute or from the root of the checkout, as it does for the tests; by default it lies beside the checkout.
shared=${DEPTHLOOM_SHARED:-../shared}
case "$shared" in
    /*) ;;
    *) shared=$PWD/$shared ;;
esac
