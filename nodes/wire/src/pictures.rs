//! Pictures and the camera's calibration, for whoever looks on; the selector reads the compressed ones.

use feeder_model::camera::CameraModel;
use minifactory_msgs::sensor_msgs::msg::{CameraInfo, CompressedImage, Image};
use minifactory_msgs::std_msgs::msg::Header;

/// What a pixel is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// A grey level of a byte.
    Grey,
    /// Red, green and blue of a byte each.
    Rgb,
}

/// A plain picture: its rows from the top, without gaps.
#[must_use]
pub fn to_image(header: Header, encoding: Encoding, (width, height): (u32, u32), data: Vec<u8>) -> Image {
    let (name, pixel_bytes) = match encoding {
        Encoding::Grey => ("mono8", 1),
        Encoding::Rgb => ("rgb8", 3),
    };
    Image { header, height, width, encoding: name.to_owned(), is_bigendian: 0, step: pixel_bytes * width, data }
}

/// A grey picture compressed as JPEG.
#[must_use]
pub fn to_compressed(header: Header, jpeg: Vec<u8>) -> CompressedImage {
    CompressedImage { header, format: "mono8; jpeg compressed mono8".to_owned(), data: jpeg }
}

/// How a camera maps, as calibrated, px.
#[must_use]
pub fn to_camera_info(header: Header, camera: &CameraModel) -> CameraInfo {
    let (k, d) = (camera.intrinsics_px(), camera.distortion());
    CameraInfo {
        header,
        height: camera.height_px(),
        width: camera.width_px(),
        distortion_model: "plumb_bob".to_owned(),
        d: vec![d.k1, d.k2, d.p1, d.p2, d.k3],
        k: std::array::from_fn(|i| k[(i / 3, i % 3)]),
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: std::array::from_fn(|i| if i % 4 < 3 { k[(i / 4, i % 4)] } else { 0.0 }),
        ..CameraInfo::default()
    }
}

#[cfg(test)]
mod tests {
    use feeder_model::camera::{CameraPose, CameraSpec, Distortion};

    use super::*;

    fn header() -> Header {
        Header { frame_id: "feeder/camera_optical".to_owned(), ..Header::default() }
    }

    #[test]
    fn a_picture_says_how_its_bytes_are_meant() {
        let picture = |encoding: &str, step, data| Image {
            header: header(),
            height: 2,
            width: 3,
            encoding: encoding.to_owned(),
            is_bigendian: 0,
            step,
            data,
        };
        let grey: Vec<u8> = (0..6).collect();
        assert_eq!(to_image(header(), Encoding::Grey, (3, 2), grey.clone()), picture("mono8", 3, grey));
        let rgb: Vec<u8> = (0..18).collect();
        assert_eq!(to_image(header(), Encoding::Rgb, (3, 2), rgb.clone()), picture("rgb8", 9, rgb));
        let compressed = to_compressed(header(), vec![1, 2, 3]);
        assert_eq!((&compressed.header, &compressed.data), (&header(), &vec![1, 2, 3]));
        assert!(compressed.format.contains("jpeg"), "{}", compressed.format);
    }

    #[test]
    fn a_calibration_has_its_matrices_row_by_row() {
        let camera = CameraModel::new(CameraSpec {
            width_px: 800,
            height_px: 600,
            focal_length_px: Some(1_000.0),
            platen_m_per_px: None,
            principal_point_px: Some([390.0, 310.0]),
            distortion: Distortion { k1: 0.01, k2: -0.02, p1: 1e-4, p2: -2e-4, k3: 0.003 },
            pose: CameraPose { x_m: 0.0, y_m: 0.0, height_m: 0.5, yaw_rad: 0.0 },
        })
        .unwrap();
        let info = to_camera_info(header(), &camera);
        assert_eq!((info.width, info.height, &info.header), (800, 600, &header()));
        assert_eq!((info.distortion_model.as_str(), info.d), ("plumb_bob", vec![0.01, -0.02, 1e-4, -2e-4, 0.003]));
        assert_eq!(info.k.to_vec(), [1_000.0, 0.0, 390.0, 0.0, 1_000.0, 310.0, 0.0, 0.0, 1.0]);
        assert_eq!(info.r.to_vec(), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(info.p.to_vec(), [1_000.0, 0.0, 390.0, 0.0, 0.0, 1_000.0, 310.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    }
}
