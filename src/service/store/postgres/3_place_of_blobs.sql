-- Which database this is: the place of its blobs bears the same name. And when its processes last kept house, ms since 1970 by the database's clock.
CREATE TABLE store (
    one INTEGER PRIMARY KEY CHECK (one = 1),
    name TEXT COLLATE "C" NOT NULL,
    house_kept BIGINT NOT NULL
);
