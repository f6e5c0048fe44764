-- Each audit log has its noted end: a database may be shared by processes with a log each.
CREATE TABLE audit_anchors (
    log TEXT PRIMARY KEY,
    chain TEXT NOT NULL,
    at TEXT NOT NULL
) STRICT;
INSERT INTO audit_anchors (log, chain, at) SELECT 'local', chain, at FROM audit_anchor;
DROP TABLE audit_anchor;
