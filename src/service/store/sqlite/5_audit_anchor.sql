-- The end of the audit log as it last was: what is cut off before it shows.
CREATE TABLE audit_anchor (
    one INTEGER PRIMARY KEY CHECK (one = 1),
    chain TEXT NOT NULL,
    at TEXT NOT NULL
) STRICT;
