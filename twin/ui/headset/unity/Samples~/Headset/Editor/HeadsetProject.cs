using UnityEditor;
using UnityEditor.SceneManagement;
using UnityEngine;
using UnityEngine.SceneManagement;

namespace Twin.Player.Samples.Editor
{
    /// <summary>Menus that prepare a project for HoloLens: capabilities of UWP, and the scene of this sample.</summary>
    public static class HeadsetProject
    {
        private const string Rig = "Packages/org.mixedrealitytoolkit.input/Assets/Prefabs/MRTK XR Rig.prefab";
        private const string Scene = "Assets/TwinHeadset.unity";

        [MenuItem("Twin/Headset/Set UWP capabilities")]
        public static void SetCapabilities()
        {
            PlayerSettings.WSACapability[] needed =
            {
                PlayerSettings.WSACapability.InternetClient, // the stream of `twin serve`
                PlayerSettings.WSACapability.PrivateNetworkClientServer,
                PlayerSettings.WSACapability.SpatialPerception, // places in the room
                PlayerSettings.WSACapability.GazeInput
            };
            foreach (PlayerSettings.WSACapability capability in needed)
            {
                PlayerSettings.WSA.SetCapability(capability, true);
            }

            Debug.Log("twin: capabilities InternetClient, PrivateNetworkClientServer, SpatialPerception, GazeInput are set");
        }

        [MenuItem("Twin/Headset/Create scene")]
        public static void CreateScene()
        {
            var rig = AssetDatabase.LoadAssetAtPath<GameObject>(Rig);
            if (rig == null)
            {
                EditorUtility.DisplayDialog("Twin", Rig + " does not exist: install MRTK3 (MRTK Input, Spatial "
                    + "Manipulation, UX Core) by the Mixed Reality Feature Tool or from OpenUPM", "OK");
                return;
            }

            Scene scene = EditorSceneManager.NewScene(NewSceneSetup.EmptyScene, NewSceneMode.Single);
            PrefabUtility.InstantiatePrefab(rig);
            new GameObject("light").AddComponent<Light>().type = LightType.Directional;
            new GameObject("twin").AddComponent<HeadsetDemo>();
            EditorSceneManager.SaveScene(scene, HeadsetProject.Scene);
            Debug.Log("twin: " + HeadsetProject.Scene + " is made; assign model and track to its object 'twin'");
        }
    }
}
