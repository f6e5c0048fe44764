//! A full disk or a database that cannot be written: errors, remaining data, and recovery of the service.

use std::fmt;
use std::path::{Path as FsPath, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use axum::http::StatusCode;
use futures::stream::BoxStream;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{
    CopyOptions, Error, GetOptions, GetResult, ListResult, MultipartUpload, ObjectMeta, ObjectStore,
    PutMultipartOptions, PutOptions, PutPayload, PutResult, Result, UploadPart,
};
use serde_json::json;
use sqlx::SqlitePool;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, nifti, skin, skull, stl};

/// Free bytes.
type Room = Arc<AtomicI64>;

/// Files on a disk with limited free space.
#[derive(Debug)]
pub(crate) struct SmallDisk {
    files: LocalFileSystem,
    root: PathBuf,
    room: Room,
}

impl SmallDisk {
    fn new(root: &FsPath) -> Arc<Self> {
        std::fs::create_dir_all(root).unwrap();
        let files = LocalFileSystem::new_with_prefix(root).unwrap().with_automatic_cleanup(true);
        Arc::new(Self { files, root: root.to_owned(), room: Arc::new(AtomicI64::new(i64::MAX)) })
    }

    fn leave(&self, bytes: i64) {
        self.room.store(bytes, Ordering::SeqCst);
    }

    /// Number of finished and unfinished files.
    fn count(&self) -> usize {
        fn below(directory: &FsPath) -> usize {
            let paths = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
            paths.map(|path| if path.is_dir() { below(&path) } else { 1 }).sum()
        }
        below(&self.root)
    }
}

fn take(room: &Room, payload: &PutPayload) -> Result<()> {
    let bytes = payload.content_length() as i64;
    if room.fetch_sub(bytes, Ordering::SeqCst) >= bytes {
        return Ok(());
    }
    room.store(0, Ordering::SeqCst);
    let source = Box::new(std::io::Error::from(std::io::ErrorKind::StorageFull));
    Err(Error::Generic { store: "small disk", source })
}

impl fmt::Display for SmallDisk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("small disk")
    }
}

#[async_trait::async_trait]
impl ObjectStore for SmallDisk {
    async fn put_opts(&self, to: &Path, payload: PutPayload, options: PutOptions) -> Result<PutResult> {
        take(&self.room, &payload)?;
        self.files.put_opts(to, payload, options).await
    }

    async fn put_multipart_opts(&self, to: &Path, options: PutMultipartOptions) -> Result<Box<dyn MultipartUpload>> {
        let upload = self.files.put_multipart_opts(to, options).await?;
        Ok(Box::new(SmallUpload { upload, room: Arc::clone(&self.room) }))
    }

    async fn get_opts(&self, from: &Path, options: GetOptions) -> Result<GetResult> {
        self.files.get_opts(from, options).await
    }

    fn delete_stream(&self, paths: BoxStream<'static, Result<Path>>) -> BoxStream<'static, Result<Path>> {
        self.files.delete_stream(paths)
    }

    fn list(&self, prefix: Option<&Path>) -> BoxStream<'static, Result<ObjectMeta>> {
        self.files.list(prefix)
    }

    async fn list_with_delimiter(&self, prefix: Option<&Path>) -> Result<ListResult> {
        self.files.list_with_delimiter(prefix).await
    }

    async fn copy_opts(&self, from: &Path, to: &Path, options: CopyOptions) -> Result<()> {
        self.files.copy_opts(from, to, options).await
    }
}

#[derive(Debug)]
struct SmallUpload {
    upload: Box<dyn MultipartUpload>,
    room: Room,
}

#[async_trait::async_trait]
impl MultipartUpload for SmallUpload {
    fn put_part(&mut self, data: PutPayload) -> UploadPart {
        match take(&self.room, &data) {
            Ok(()) => self.upload.put_part(data),
            Err(error) => Box::pin(async { Err(error) }),
        }
    }

    async fn complete(&mut self) -> Result<PutResult> {
        self.upload.complete().await
    }

    async fn abort(&mut self) -> Result<()> {
        self.upload.abort().await
    }
}

async fn app_on_small_disk() -> (TestApp, Arc<SmallDisk>, tempfile::TempDir) {
    let directory = tempfile::tempdir().unwrap();
    let disk = SmallDisk::new(directory.path());
    let app = TestApp::with_objects(Arc::clone(&disk) as _).await;
    (app, disk, directory)
}

#[tokio::test]
async fn an_upload_to_a_full_disk_leaves_no_files() {
    let (app, disk, _directory) = app_on_small_disk().await;
    let session = app.session().await;
    disk.leave(100);
    app.upload(&format!("{session}/skin"), skin()).await.problem(507, "storage-full");
    // The first part of 5 MB is written before the disk is full.
    let mut large = stl(&cube([0.0; 3], 50.0));
    large.resize(12 << 20, 0);
    disk.leave(6 << 20);
    app.upload(&format!("{session}/skull"), large).await.problem(507, "storage-full");
    disk.leave(100);
    app.upload(&format!("{session}/ct"), nifti()).await.problem(507, "storage-full");
    let view = app.get(&session).await.ok();
    assert_eq!((&view["bytes"], &view["jobs"]), (&json!(0), &json!([])), "{view}");
    assert!(["skin", "skull", "ct"].iter().all(|part| view["parts"][part]["state"] == "missing"), "{view}");
    assert_eq!(disk.count(), 0);
    disk.leave(i64::MAX);
    app.upload(&format!("{session}/skin"), skin()).await.ok();
    app.upload(&format!("{session}/skull"), skull()).await.ok();
}

#[tokio::test]
async fn a_job_on_a_full_disk_fails_and_keeps_its_steps() {
    let (app, disk, _directory) = app_on_small_disk().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({"steps": 3})).await;
    app.until_step(&job, 1).await;
    let before = disk.count();
    disk.leave(10);
    app.stand_in.release();
    let ended = app.ended(&job).await.ok();
    assert_eq!((&ended["status"], &ended["problem"]["type"]), (&json!("failed"), &json!("/problems/storage-full")));
    assert_eq!((&ended["step"], &ended["problem"]["status"]), (&json!(1), &json!(507)), "{ended}");
    assert_eq!(app.get(&format!("{job}/steps/1/skin")).await.status, StatusCode::OK);
    app.get(&format!("{job}/steps/2/skin")).await.problem(404, "not-ready");
    assert_eq!(disk.count(), before, "unfinished results leave no files");

    // No job can start either; once there is space, the same request succeeds.
    let refused = app.solve(&session, &plan, json!({"steps": 2})).await;
    let ended = app.ended(&refused).await.ok();
    assert_eq!(ended["problem"]["type"], "/problems/storage-full", "{ended}");
    disk.leave(i64::MAX);
    let again = app.solve(&session, &plan, json!({"steps": 3})).await;
    assert_eq!(app.ended(&again).await.ok()["status"], "succeeded");
    assert_eq!(app.get("/readyz").await.status, StatusCode::OK);
}

/// Below the room that is kept free, sessions can be read and deleted, and jobs wait.
#[tokio::test]
async fn a_full_disk_can_be_emptied() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let (other, _) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({"steps": 3})).await;
    app.until_step(&job, 1).await;
    let unwanted = app.solve(&session, &plan, json!({"steps": 2})).await;
    let store = app.state.service.store();
    store.keep_free(u64::MAX);
    app.get("/readyz").await.problem(507, "storage-full");
    assert_eq!(app.get("/livez").await.status, StatusCode::OK);
    app.post("/v1/sessions", json!({})).await.problem(507, "storage-full");
    app.upload(&format!("{session}/skin"), skin()).await.problem(507, "storage-full");
    app.post(&format!("{session}/jobs"), json!({"plan": plan})).await.problem(507, "storage-full");
    let cancelled = app.post(&format!("{unwanted}/cancel"), json!({})).await;
    assert!(cancelled.status.is_success(), "{cancelled:?}");
    assert_eq!(app.delete(&format!("{other}?at_once=true")).await.status, StatusCode::NO_CONTENT);
    app.get(&other).await.problem(410, "gone");
    // The running job cannot store its next step: it waits, and keeps the steps that it has.
    app.stand_in.release();
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
    while app.get(&job).await.ok()["status"] != "accepted" {
        assert!(std::time::Instant::now() < deadline);
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    assert_eq!(app.get(&format!("{job}/steps/1/skin")).await.status, StatusCode::OK);

    // With twice as much as is kept free, all is accepted, and `/readyz` warns.
    store.keep_free(store.free_room().unwrap().unwrap().bytes / 2);
    assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    app.session().await;
    let nearly = app.get("/readyz").await;
    assert!(nearly.status == StatusCode::OK && nearly.body.starts_with(b"ok, but the disk has "), "{nearly:?}");
    store.keep_free(0);
    assert_eq!(app.get("/readyz").await.body, "ok\n");
}

/// The database refuses to record the end of a job for some time.
#[tokio::test]
async fn the_end_of_a_job_is_recorded_once_the_database_can_be_written_again() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let database =
        SqlitePool::connect(&format!("sqlite://{}/prosopon.sqlite", app.directory().display())).await.unwrap();
    let run = async |sql: &'static str| sqlx::raw_sql(sql).execute(&database).await.unwrap();
    run("CREATE TRIGGER broken BEFORE UPDATE ON jobs WHEN NEW.state IN ('succeeded', 'failed')
         BEGIN SELECT RAISE(ABORT, 'planted'); END")
    .await;
    let job = app.solve(&session, &plan, json!({"outputs": ["skin", "tissue"]})).await;
    app.until_step(&job, 1).await;
    let waiting = app.get(&format!("{job}?wait_s=1")).await.ok();
    assert_eq!(waiting["status"], "running", "{waiting}");
    assert_eq!(app.get("/livez").await.status, StatusCode::OK);
    run("DROP TRIGGER broken").await;
    let ended = app.ended(&job).await.ok();
    assert_eq!(ended["status"], "succeeded", "{ended}");
    assert_eq!(app.get(&format!("{job}/tissue")).await.status, StatusCode::OK, "its results are there");
    let next = app.solve(&session, &plan, json!({"steps": 1})).await;
    assert_eq!(app.ended(&next).await.ok()["status"], "succeeded");
    database.close().await;
}
