//! The graph language: values, ports, contracts, and YAML to a checked, shared plan.
