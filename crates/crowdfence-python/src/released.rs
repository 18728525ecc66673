//! Work of the core, with the interpreter released and on the core's threads. A process that was forked has none of
//! the threads of its parent, and work given to them would wait for ever: it gets threads of its own.

use std::sync::{Arc, Mutex, OnceLock};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Whose the core's first threads are.
static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();
/// Threads of this process where it is another one, with its id.
static OWN: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

pub fn released<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    py.detach(|| {
        let process = std::process::id();
        match *FIRST_PROCESS.get_or_init(|| process) == process {
            true => work(),
            false => threads_of(process).install(work),
        }
    })
}

fn threads_of(process: u32) -> Arc<ThreadPool> {
    let mut own = OWN.lock().expect("nothing panics with it");
    match &*own {
        Some((owner, threads)) if *owner == process => threads.clone(),
        _ => {
            let threads = Arc::new(ThreadPoolBuilder::new().build().expect("a process can start threads"));
            // Those of the parent are not ended here: there is nobody left to be told.
            std::mem::forget(own.replace((process, threads.clone())));
            threads
        }
    }
}
