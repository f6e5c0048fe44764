CREATE TABLE sessions (
    id TEXT PRIMARY KEY,
    label TEXT,
    settings TEXT NOT NULL,
    created_at TEXT NOT NULL
) STRICT;

CREATE TABLE parts (
    session TEXT NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    kind TEXT NOT NULL,
    key TEXT NOT NULL,
    blob TEXT,
    bytes INTEGER NOT NULL,
    wall_s REAL NOT NULL,
    document TEXT NOT NULL,
    updated_at TEXT NOT NULL,
    PRIMARY KEY (session, kind)
) STRICT;

CREATE TABLE osteotomies (
    id TEXT PRIMARY KEY,
    session TEXT NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    field_key TEXT NOT NULL,
    wall_s REAL NOT NULL,
    bytes INTEGER NOT NULL,
    document TEXT NOT NULL,
    blobs TEXT NOT NULL,
    created_at TEXT NOT NULL
) STRICT;

CREATE TABLE plans (
    id TEXT PRIMARY KEY,
    session TEXT NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    osteotomy TEXT NOT NULL REFERENCES osteotomies (id) ON DELETE CASCADE,
    document TEXT NOT NULL,
    created_at TEXT NOT NULL
) STRICT;

CREATE TABLE jobs (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    session TEXT NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    kind TEXT NOT NULL,
    state TEXT NOT NULL,
    phase TEXT NOT NULL,
    progress REAL NOT NULL,
    steps INTEGER NOT NULL,
    attempt INTEGER NOT NULL,
    request TEXT NOT NULL,
    report TEXT,
    fault TEXT,
    warnings TEXT NOT NULL,
    rest_blob TEXT,
    tissue_blob TEXT,
    bytes INTEGER NOT NULL,
    created_at TEXT NOT NULL,
    started_at TEXT,
    finished_at TEXT
) STRICT;
CREATE INDEX jobs_by_state ON jobs (state, number);

CREATE TABLE steps (
    job TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    k INTEGER NOT NULL,
    t REAL NOT NULL,
    document TEXT NOT NULL,
    error TEXT,
    blob TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    bytes INTEGER NOT NULL,
    PRIMARY KEY (job, k)
) STRICT;

CREATE TABLE events (
    job TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    seq INTEGER NOT NULL,
    kind TEXT NOT NULL,
    data TEXT NOT NULL,
    PRIMARY KEY (job, seq)
) STRICT;

CREATE TABLE idempotency (
    key TEXT PRIMARY KEY,
    request_sha256 TEXT NOT NULL,
    status INTEGER NOT NULL,
    location TEXT,
    retry_after TEXT,
    body TEXT NOT NULL,
    session TEXT,
    created_at TEXT NOT NULL
) STRICT;

CREATE TABLE tombstones (
    id TEXT PRIMARY KEY,
    deleted_at TEXT NOT NULL
) STRICT;
