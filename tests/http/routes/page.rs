use crate::support::app::TestApp;

#[tokio::test]
async fn the_start_page_links_to_the_documentation() {
    let app = TestApp::new().await;
    let page = app.get("/").await;
    assert!(page.header("content-type").starts_with("text/html"));
    assert!(String::from_utf8(page.body.to_vec()).unwrap().contains("/docs/"));
}

#[tokio::test]
async fn every_link_of_the_start_page_is_answered() {
    let app = TestApp::new().await;
    let page = String::from_utf8(app.get("/").await.body.to_vec()).unwrap();
    let links: Vec<&str> = page.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert!(links.contains(&"/v1/sessions"), "{links:?}");
    for link in links {
        assert!(app.get(link).await.status.is_success(), "{link}");
    }
}
