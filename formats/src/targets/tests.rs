//! Shards there and back, and what is wrong with spoilt ones.

use std::path::Path;

use super::*;

fn config() -> TargetsConfig {
    TargetsConfig { with_features: true, image_size: Some([10, 20]), seed: 7, ..TargetsConfig::default() }
}

fn clip(primitives: usize, features: Option<usize>) -> ClipTargets {
    let index: Vec<u32> = (0..primitives as u64).step_by(2).filter_map(|i| u32::try_from(i).ok()).collect();
    let m = index.len();
    let mask: Vec<bool> = (0..m).map(|i| i % 3 != 1).collect();
    let action = |salt: f32| ActionTargets {
        y: mask.iter().enumerate().map(|(i, &set)| if set { salt / (i + 2) as f32 } else { 0.5 }).collect(),
        delta: (0..m).map(|i| salt - i as f32).collect(),
        mask: mask.clone(),
    };
    ClipTargets {
        index,
        samples: vec![2; m],
        prune: action(0.25),
        add: action(0.75),
        moments: [[0.5, 1.5], [-0.5, 2.0]],
        gaussians: (0..primitives).map(|i| [i as f32; NUM_ATTRIBUTES]).collect(),
        times: vec![0.1; primitives],
        frames: features.map(|_| vec![3; primitives]),
        velocities: vec![[1.0, 2.0, 3.0]; primitives],
        features: features.map(|width| HalfFeatures { width, bits: vec![0x3c00; primitives * width] }),
    }
}

fn write(path: &Path, clips: &[(&str, ClipTargets)]) -> WrittenShard {
    let encoded: Vec<EncodedClip> = clips.iter().map(|(_, c)| EncodedClip::new(path, c).unwrap()).collect();
    let dims: Vec<(&str, ClipDims)> = clips.iter().zip(&encoded).map(|((n, _), e)| (*n, e.dims)).collect();
    write_shard(path, &config(), &dims, |i| Ok(encoded[i].clone())).unwrap()
}

#[test]
fn clips_come_back_as_they_were_and_repacking_keeps_their_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    let clips = [("one", clip(7, Some(3))), ("none", clip(0, Some(3))), ("two~2", clip(4, Some(3)))];
    write(&path, &clips);
    let shard = Shard::read(&path).unwrap();
    assert_eq!((shard.names(), shard.config()), (&["one", "none", "two~2"].map(str::to_owned)[..], &config()));
    for (i, (name, clip)) in clips.iter().enumerate() {
        assert_eq!(&shard.clip(name).unwrap(), clip);
        assert_eq!(shard.encoded(i).unwrap(), EncodedClip::new(&path, clip).unwrap());
    }
    assert!(shard.clip("three").unwrap_err().to_string().contains("three"));
    let without = dir.path().join("b");
    write(&without, &[("plain", clip(5, None))]);
    assert_eq!(Shard::read(&without).unwrap().clip("plain").unwrap(), clip(5, None));
}

#[test]
fn bytes_are_those_of_the_document() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    write(&path, &[("c", clip(1, None))]);
    let bytes = std::fs::read(&path).unwrap();
    let len = usize::try_from(u64::from_le_bytes(bytes[..8].try_into().unwrap())).unwrap();
    let header = std::str::from_utf8(&bytes[8..8 + len]).unwrap();
    assert!(
        len % 8 == 0 && header.starts_with("{\"__metadata__\":{\"config\":\"{\\\"signal\\\":\\\"response\\\""),
        "{header}"
    );
    let tail = "\"format\":\"lgs-targets/1\"},\"c/moments\":{\"dtype\":\"F64\",\"shape\":[2,2],\"data_offsets\":[0,32]},\
                \"c/index\":{\"dtype\":\"U32\",\"shape\":[1],\"data_offsets\":[32,36]}";
    assert!(header.contains(tail), "{header}");
    assert!(
        header.trim_end().ends_with("\"c/samples\":{\"dtype\":\"U8\",\"shape\":[1],\"data_offsets\":[126,127]}}"),
        "{header}"
    );
    assert_eq!(bytes.len(), 8 + len + 127);
    assert_eq!(bytes[8 + len + 36..8 + len + 40], 0.125_f32.to_le_bytes());
}

#[test]
fn shards_without_frames_are_read_and_tell_them_apart_by_time() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    let known = ClipTargets { frames: Some(vec![4, 4, 6, 6]), ..clip(4, None) };
    let unknown = ClipTargets { times: vec![0.1, -0.2, 0.1, 0.3], ..clip(4, None) };
    write(&path, &[("known", known.clone()), ("unknown", unknown.clone())]);
    let shard = Shard::read(&path).unwrap();
    assert_eq!(shard.clip("known").unwrap(), known);
    let found = shard.clip("unknown").unwrap();
    assert_eq!((&found, found.frames_of_times()), (&unknown, vec![0, 1, 0, 2]));
    let short = ClipTargets { frames: Some(vec![0; 3]), ..clip(4, None) };
    let message = EncodedClip::new(&path, &short).unwrap_err().to_string();
    assert!(message.ends_with("frame: expected 4 values, found 3"), "{message}");
}

#[test]
fn a_flipped_byte_is_named_by_the_manifest_and_spoilt_values_by_the_reader() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(shard_file(0));
    let WrittenShard { bytes, sha256 } = write(&path, &[("c", clip(9, Some(2)))]);
    let record = ClipCounts { clip: "c".into(), primitives: 9, sampled: 5, valid_prune: 4, valid_add: 4 };
    let shards = vec![ShardRecord { file: shard_file(0), bytes, sha256, clips: vec![record] }];
    let manifest = Manifest {
        format: TARGETS_FORMAT.into(),
        part: None,
        config: config(),
        clips: vec!["c".into()],
        shards,
        failed: Vec::new(),
    };
    let at = dir.path().join(MANIFEST_FILE);
    manifest.write(&at).unwrap();
    let read = Manifest::read(&at).unwrap();
    assert_eq!(read, manifest);
    read.verify(dir.path()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for flipped in (0..whole.len()).step_by(13) {
        let mut bytes = whole.clone();
        bytes[flipped] ^= 0x41;
        std::fs::write(&path, &bytes).unwrap();
        let message = read.verify(dir.path()).unwrap_err().to_string();
        assert!(message.contains("targets-00000.safetensors: SHA-256"), "{message}");
        // Whatever the byte was, the reader comes to an end without a panic.
        if let Ok(shard) = Shard::parse(&path, bytes) {
            let _ = shard.clip("c");
        }
    }
    for len in [0, 7, 8, 100, whole.len() - 1] {
        std::fs::write(&path, &whole[..len]).unwrap();
        assert!(read.verify(dir.path()).unwrap_err().to_string().contains("targets-00000.safetensors: size"));
        assert!(Shard::read(&path).is_err(), "{len} bytes");
    }
}

#[test]
fn values_that_the_format_does_not_allow_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    let refuses = |change: fn(&mut ClipTargets), want: &str| {
        let mut spoilt = clip(9, None);
        change(&mut spoilt);
        write(&path, &[("c", spoilt)]);
        let message = Shard::read(&path).unwrap().clip("c").unwrap_err().to_string();
        assert!(message.contains(want), "{message}");
    };
    refuses(|c| c.index[1] = 9, "c/index[1]: expected ascending indices below 9, found 9");
    refuses(|c| c.index[2] = c.index[1], "c/index[2]");
    refuses(|c| c.prune.y[0] = 1.5, "c/y_prune[0]");
    refuses(|c| c.add.y[1] = 0.4, "c/y_add[1]");
    refuses(|c| c.add.delta[3] = f32::NAN, "c/delta_add[3]: expected a finite value, found NaN");
    refuses(|c| c.gaussians[8][13] = f32::INFINITY, "c/gaussians[125]");
    refuses(|c| c.samples[0] = 0, "c/samples[0]");
    refuses(|c| c.moments[1][0] = f64::NAN, "c/moments[2]");
}

#[test]
fn a_manifest_may_not_point_out_of_its_folder() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(MANIFEST_FILE);
    let text = |file: &str| {
        let config = serde_json::to_string(&config()).unwrap();
        format!(
            "{{\"format\":\"lgs-targets/1\",\"part\":null,\"config\":{config},\"clips\":[],\"failed\":[],\
             \"shards\":[{{\"file\":\"{file}\",\"bytes\":1,\"sha256\":\"\",\"clips\":[]}}]}}"
        )
    };
    for (file, good) in [("a", true), ("clips/a", true), ("../a", false), ("/a", false), ("", false)] {
        std::fs::write(&path, text(file)).unwrap();
        assert_eq!(Manifest::read(&path).is_ok(), good, "{file}");
    }
}
