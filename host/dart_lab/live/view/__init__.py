"""A live page of a car: seen by everybody, stopped by everybody, driven by one."""
