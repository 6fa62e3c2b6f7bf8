"""The foundation of both packages: types, units, errors, configuration, ports, processes."""
