-- A plan may name segments of a tissue mesh instead of those of an osteotomy.
CREATE TABLE plans_next (
    id TEXT PRIMARY KEY,
    session TEXT NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    osteotomy TEXT REFERENCES osteotomies (id) ON DELETE CASCADE,
    document TEXT NOT NULL,
    created_at TEXT NOT NULL
) STRICT;
INSERT INTO plans_next (id, session, osteotomy, document, created_at)
    SELECT id, session, osteotomy, document, created_at FROM plans;
DROP TABLE plans;
ALTER TABLE plans_next RENAME TO plans;
