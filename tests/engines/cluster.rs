use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};

use sqlx::{AssertSqlSafe, Connection, PgConnection};

const PASSWORD: &str = "s/ecret";

/// A private Postgres server in its own directory; it stops with the process that started it.
#[derive(Debug)]
pub(crate) struct Cluster {
    port: u16,
    /// The server stops when this is closed, also when the process is killed.
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
    _script: Child,
}

impl Cluster {
    /// Starts a server without `fsync`: tests need no durability after a crash of the machine.
    pub(crate) fn start() -> Self {
        Self::start_with(false)
    }

    /// Starts a server; with `durable` it waits for the disk (`fsync`).
    pub(crate) fn start_with(durable: bool) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        // Postgres refuses to run as root, and an ordinary user may not be able to read this directory.
        let script = include_str!("cluster.sh");
        let mut command = if is_root() {
            let mut command = Command::new("setpriv");
            command.args(["--reuid=nobody", "--regid=nogroup", "--clear-groups", "sh"]);
            command
        } else {
            Command::new("sh")
        };
        command.arg("-c").arg(script).arg("cluster").arg(programs()).arg(port.to_string()).arg(PASSWORD);
        command.arg(include_str!("../data/tls/cert.pem")).arg(include_str!("../data/tls/key.pem"));
        command.env("FSYNC", if durable { "on" } else { "off" });
        command.current_dir("/").stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut script = command.spawn().expect("sh and setpriv (util-linux) are there");
        let (orders, answers) = (script.stdin.take().unwrap(), BufReader::new(script.stdout.take().unwrap()));
        let mut cluster = Self { port, orders, answers, _script: script };
        cluster.wait();
        cluster
    }

    fn wait(&mut self) {
        let mut answer = String::new();
        self.answers.read_line(&mut answer).unwrap();
        assert_eq!(answer, "ready\n", "the private Postgres server did not start; what it said is above");
    }

    /// Stops the server, which breaks all connections, and starts it again.
    pub(crate) fn restart(&mut self) {
        self.order("restart");
    }

    /// Suspends the server: connections stay open and get no answer.
    pub(crate) fn halt(&mut self) {
        self.order("halt");
    }

    /// Resumes the server.
    pub(crate) fn go_on(&mut self) {
        self.order("continue");
    }

    fn order(&mut self, order: &str) {
        writeln!(self.orders, "{order}").unwrap();
        self.wait();
    }

    fn url(&self, database: &str) -> String {
        format!("postgres://prosopon:{}@127.0.0.1:{}/{database}", PASSWORD.replace('/', "%2F"), self.port)
    }

    /// The address of a new empty database.
    pub(crate) async fn fresh_database(&self) -> String {
        static MADE: AtomicU32 = AtomicU32::new(0);
        let name = format!("test_{}", MADE.fetch_add(1, Ordering::Relaxed));
        let mut connection = PgConnection::connect(&self.url("postgres")).await.unwrap();
        sqlx::query(AssertSqlSafe(format!("CREATE DATABASE {name}"))).execute(&mut connection).await.unwrap();
        connection.close().await.unwrap();
        self.url(&name)
    }
}

/// The address of a new empty database on the server that this process shares.
pub(crate) async fn fresh_database() -> String {
    static CLUSTER: OnceLock<Cluster> = OnceLock::new();
    CLUSTER.get_or_init(Cluster::start).fresh_database().await
}

fn is_root() -> bool {
    let output = Command::new("id").arg("-u").output().expect("id (coreutils) is there");
    output.stdout == b"0\n"
}

/// Folder of `initdb` and `postgres`; Debian has one such folder per version.
fn programs() -> PathBuf {
    let versions =
        std::fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten().map(|v| v.path().join("bin"));
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let mut found: Vec<PathBuf> = std::env::split_paths(&paths).chain(versions).collect();
    found.retain(|bin| ["initdb", "postgres", "pg_isready"].iter().all(|program| bin.join(program).is_file()));
    found.sort();
    found.pop().expect("these tests need Postgres: install Debian's package postgresql (its service need not run)")
}
