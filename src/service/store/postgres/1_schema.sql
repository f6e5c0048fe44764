-- Ids, times and words compare byte for byte (COLLATE "C"), whatever the language of the database.
CREATE TABLE sessions (
    id TEXT COLLATE "C" PRIMARY KEY,
    tenant TEXT COLLATE "C" NOT NULL,
    label TEXT,
    settings TEXT NOT NULL,
    created_at TEXT COLLATE "C" NOT NULL
);
CREATE INDEX sessions_by_tenant ON sessions (tenant, id);

CREATE TABLE parts (
    session TEXT COLLATE "C" NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    kind TEXT COLLATE "C" NOT NULL,
    key TEXT NOT NULL,
    blob TEXT,
    bytes BIGINT NOT NULL,
    wall_s DOUBLE PRECISION NOT NULL,
    document TEXT NOT NULL,
    updated_at TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (session, kind)
);

CREATE TABLE osteotomies (
    id TEXT COLLATE "C" PRIMARY KEY,
    session TEXT COLLATE "C" NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    field_key TEXT NOT NULL,
    wall_s DOUBLE PRECISION NOT NULL,
    bytes BIGINT NOT NULL,
    document TEXT NOT NULL,
    blobs TEXT NOT NULL,
    created_at TEXT COLLATE "C" NOT NULL
);
CREATE INDEX osteotomies_by_session ON osteotomies (session, id);

CREATE TABLE plans (
    id TEXT COLLATE "C" PRIMARY KEY,
    session TEXT COLLATE "C" NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    osteotomy TEXT COLLATE "C" REFERENCES osteotomies (id) ON DELETE CASCADE,
    document TEXT NOT NULL,
    created_at TEXT COLLATE "C" NOT NULL
);
CREATE INDEX plans_by_session ON plans (session, id);
CREATE INDEX plans_by_osteotomy ON plans (osteotomy);

CREATE TABLE jobs (
    number BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    id TEXT COLLATE "C" NOT NULL UNIQUE,
    session TEXT COLLATE "C" NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    tenant TEXT COLLATE "C" NOT NULL,
    kind TEXT NOT NULL,
    lane TEXT COLLATE "C" NOT NULL,
    state TEXT NOT NULL,
    phase TEXT NOT NULL,
    progress DOUBLE PRECISION NOT NULL,
    steps BIGINT NOT NULL,
    attempt BIGINT NOT NULL,
    fence BIGINT NOT NULL DEFAULT 0,
    request TEXT NOT NULL,
    subject TEXT,
    other_session TEXT COLLATE "C" REFERENCES sessions (id) ON DELETE CASCADE,
    max_wall_s DOUBLE PRECISION,
    traceparent TEXT,
    cancel_requested_at TEXT COLLATE "C",
    superseded_by TEXT,
    events_from BIGINT NOT NULL DEFAULT 1,
    report TEXT,
    fault TEXT,
    warnings TEXT NOT NULL,
    rest_blob TEXT,
    tissue_blob TEXT,
    bytes BIGINT NOT NULL,
    created_at TEXT COLLATE "C" NOT NULL,
    started_at TEXT COLLATE "C",
    finished_at TEXT COLLATE "C"
);
CREATE INDEX jobs_by_state ON jobs (state, number);
CREATE INDEX jobs_by_session ON jobs (session, id);
CREATE INDEX jobs_by_other_session ON jobs (other_session);
CREATE INDEX jobs_by_tenant ON jobs (tenant, id);

-- When each tenant had its last turn in a lane.
CREATE TABLE turns (
    tenant TEXT COLLATE "C" NOT NULL,
    lane TEXT COLLATE "C" NOT NULL,
    last BIGINT NOT NULL,
    PRIMARY KEY (tenant, lane)
);
CREATE SEQUENCE turn;

CREATE TABLE steps (
    job TEXT COLLATE "C" NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    k BIGINT NOT NULL,
    t DOUBLE PRECISION NOT NULL,
    document TEXT NOT NULL,
    error TEXT,
    blob TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    bytes BIGINT NOT NULL,
    PRIMARY KEY (job, k)
);

CREATE TABLE events (
    job TEXT COLLATE "C" NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    seq BIGINT NOT NULL,
    kind TEXT NOT NULL,
    data TEXT NOT NULL,
    PRIMARY KEY (job, seq)
);

CREATE TABLE answers (
    tenant TEXT COLLATE "C" NOT NULL,
    key TEXT COLLATE "C" NOT NULL,
    request_sha256 TEXT NOT NULL,
    status BIGINT NOT NULL,
    location TEXT,
    retry_after TEXT,
    body TEXT NOT NULL,
    session TEXT COLLATE "C",
    created_at TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (tenant, key)
);
CREATE INDEX answers_by_session ON answers (session);

CREATE TABLE tombstones (
    id TEXT COLLATE "C" PRIMARY KEY,
    deleted_at TEXT COLLATE "C" NOT NULL,
    tenant TEXT COLLATE "C" NOT NULL
);

-- The end of each audit log as it last was: what is cut off before it shows.
CREATE TABLE audit_anchors (
    log TEXT PRIMARY KEY,
    chain TEXT NOT NULL,
    at TEXT NOT NULL
);
