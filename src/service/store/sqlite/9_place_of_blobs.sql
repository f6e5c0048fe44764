-- Which database this is: the place of its blobs bears the same name. And when its processes last kept house, ms since 1970.
CREATE TABLE store (
    one INTEGER PRIMARY KEY CHECK (one = 1),
    name TEXT NOT NULL,
    house_kept INTEGER NOT NULL
) STRICT;
