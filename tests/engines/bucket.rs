use std::sync::Arc;
use std::time::Duration;

use hyper_util::rt::{TokioExecutor, TokioIo};
use hyper_util::server::conn::auto::Builder;
use object_store::aws::AmazonS3Builder;
use s3s::access::{S3Access, S3AccessContext};
use s3s::auth::SimpleAuth;
use s3s::service::S3ServiceBuilder;
use s3s::{S3Result, s3_error};
use s3s_fs::FileSystem;
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

const NAME: &str = "plans";
const KEY: &str = "key";
const SECRET: &str = "secret";

/// Duration of a removal while one value is refused.
const REMOVAL: Duration = Duration::from_secs(12);

/// How a store answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mood {
    Serving,
    /// Answers 503 and breaks open connections.
    Away,
    /// Answers 403, as for an access key that is no longer valid.
    Refusing,
    /// Accepts requests and does not answer.
    Silent,
}

/// An S3-compatible store with one bucket on loopback, served by the runtime of the test.
#[derive(Debug)]
pub(crate) struct Bucket {
    endpoint: String,
    mood: watch::Sender<Mood>,
    kept_back: watch::Sender<Option<String>>,
    _files: Arc<TempDir>,
}

impl Bucket {
    /// Starts the store with an empty bucket.
    pub(crate) async fn start() -> Self {
        let files = Arc::new(tempfile::tempdir().unwrap());
        std::fs::create_dir(files.path().join(NAME)).unwrap();
        let mut service = S3ServiceBuilder::new(FileSystem::new(files.path()).unwrap());
        service.set_auth(SimpleAuth::from_single(KEY, SECRET));
        let (kept_back, policy) = watch::channel(None);
        service.set_access(Policy(policy));
        let service = service.build();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let endpoint = format!("http://{}", listener.local_addr().unwrap());
        let kept = Arc::clone(&files);
        let (mood, moods) = watch::channel(Mood::Serving);
        tokio::spawn(async move {
            while let Ok((connection, _)) = listener.accept().await {
                let (service, kept, mut mood) = (service.clone(), Arc::clone(&kept), moods.clone());
                tokio::spawn(async move {
                    let now = *mood.borrow_and_update();
                    match now {
                        Mood::Serving => {}
                        Mood::Away => return refuse(connection, "503 Service Unavailable").await,
                        Mood::Refusing => return refuse(connection, "403 Forbidden").await,
                        Mood::Silent => {
                            mood.changed().await.ok();
                            return;
                        }
                    }
                    let served = Builder::new(TokioExecutor::new());
                    tokio::select! {
                        _ = served.serve_connection(TokioIo::new(connection), service) => {}
                        _ = mood.changed() => {}
                    }
                    drop(kept);
                });
            }
        });
        Self { endpoint, mood, kept_back, _files: files }
    }

    /// Refuses all requests for this key from now on, as a policy or an encryption key may; other removals take seconds.
    pub(crate) fn keep_back(&self, key: Option<String>) {
        self.kept_back.send_replace(key);
    }

    /// Answers new connections in this way from now on; open connections break.
    pub(crate) fn set(&self, mood: Mood) {
        self.mood.send_replace(mood);
    }

    /// Environment variables for a service that uses this bucket.
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

    /// Its address in the form of the service's `blobs` setting.
    pub(crate) fn url(&self) -> String {
        format!("s3://{NAME}/patients")
    }
}

/// Grants all operations to owners of the access key, except on one value.
struct Policy(watch::Receiver<Option<String>>);

#[async_trait::async_trait]
impl S3Access for Policy {
    async fn check(&self, request: &mut S3AccessContext<'_>) -> S3Result<()> {
        let key = request.s3_path().get_object_key().unwrap_or_default();
        let all = self.0.borrow().is_none();
        let kept_back = self.0.borrow().as_ref().is_some_and(|kept| key.ends_with(kept.as_str()));
        if !all && request.s3_op().name().starts_with("DeleteObject") {
            tokio::time::sleep(REMOVAL).await;
        }
        if kept_back || request.credentials().is_none() { Err(s3_error!(AccessDenied)) } else { Ok(()) }
    }
}

async fn refuse(mut connection: TcpStream, status: &str) {
    let mut head = [0; 4096];
    if matches!(connection.read(&mut head).await, Ok(0) | Err(_)) {
        return;
    }
    let answer = format!("HTTP/1.1 {status}\r\ncontent-length: 0\r\nconnection: close\r\n\r\n");
    connection.write_all(answer.as_bytes()).await.ok();
}
