"""Room of the grades: how sure a name is, how large it is in each recording, is it constant."""
