use std::sync::Arc;

use hyper_util::rt::{TokioExecutor, TokioIo};
use hyper_util::server::conn::auto::Builder;
use object_store::aws::AmazonS3Builder;
use s3s::auth::SimpleAuth;
use s3s::service::S3ServiceBuilder;
use s3s_fs::FileSystem;
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

const NAME: &str = "plans";
const KEY: &str = "key";
const SECRET: &str = "secret";

/// An S3-compatible store with one bucket, on loopback, served by the runtime of the test.
#[derive(Debug)]
pub(crate) struct Bucket {
    endpoint: String,
    away: watch::Sender<bool>,
    _files: Arc<TempDir>,
}

impl Bucket {
    /// Starts the store with an empty bucket.
    pub(crate) async fn start() -> Self {
        let files = Arc::new(tempfile::tempdir().unwrap());
        std::fs::create_dir(files.path().join(NAME)).unwrap();
        let mut service = S3ServiceBuilder::new(FileSystem::new(files.path()).unwrap());
        service.set_auth(SimpleAuth::from_single(KEY, SECRET));
        let service = service.build();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let endpoint = format!("http://{}", listener.local_addr().unwrap());
        let kept = Arc::clone(&files);
        let (away, is_away) = watch::channel(false);
        tokio::spawn(async move {
            while let Ok((connection, _)) = listener.accept().await {
                let (service, kept, mut is_away) = (service.clone(), Arc::clone(&kept), is_away.clone());
                tokio::spawn(async move {
                    if *is_away.borrow_and_update() {
                        return refuse(connection).await;
                    }
                    let served = Builder::new(TokioExecutor::new());
                    tokio::select! {
                        _ = served.serve_connection(TokioIo::new(connection), service) => {}
                        _ = is_away.changed() => {}
                    }
                    drop(kept);
                });
            }
        });
        Self { endpoint, away, _files: files }
    }

    /// From now on every connection breaks, and new ones are answered with 503; or that is over.
    pub(crate) fn set_away(&self, away: bool) {
        self.away.send_replace(away);
    }

    /// What the environment says to a service.
    pub(crate) fn environment(&self) -> [(&'static str, String); 5] {
        [
            ("AWS_ENDPOINT_URL", self.endpoint.clone()),
            ("AWS_ALLOW_HTTP", "true".to_owned()),
            ("AWS_REGION", "eu-central-1".to_owned()),
            ("AWS_ACCESS_KEY_ID", KEY.to_owned()),
            ("AWS_SECRET_ACCESS_KEY", SECRET.to_owned()),
        ]
    }

    /// The same for a client within this process.
    pub(crate) fn client(&self) -> AmazonS3Builder {
        self.environment().into_iter().fold(AmazonS3Builder::new(), |client, (name, value)| {
            client.with_config(name.to_ascii_lowercase().parse().unwrap(), value)
        })
    }

    /// Its address, as a service takes it.
    pub(crate) fn url(&self) -> String {
        format!("s3://{NAME}/patients")
    }
}

async fn refuse(mut connection: TcpStream) {
    let mut head = [0; 4096];
    if matches!(connection.read(&mut head).await, Ok(0) | Err(_)) {
        return;
    }
    connection
        .write_all(b"HTTP/1.1 503 Service Unavailable\r\ncontent-length: 0\r\nconnection: close\r\n\r\n")
        .await
        .ok();
}
