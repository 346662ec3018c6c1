// A stub of UnityEngine.JsonUtility, as strict as that: public fields of serializable classes, numbers, booleans,
// strings, and arrays of these one deep. No dictionaries, no arrays in arrays, no nullable types. Names that the class
// lacks are skipped; null and values of another kind leave a field as it was.
using System;
using System.Collections;
using System.Collections.Generic;
using System.Globalization;
using System.Reflection;
using System.Text;

namespace UnityEngine
{
    public static class JsonUtility
    {
        public static T FromJson<T>(string json)
        {
            if (string.IsNullOrEmpty(json)) return default(T);
            object tree = new Reader(json).Whole();
            if (!(tree is Dictionary<string, object>)) throw new ArgumentException("JSON must represent an object type.");
            return (T)Fill((Dictionary<string, object>)tree, typeof(T));
        }

        private static object Fill(Dictionary<string, object> from, Type type)
        {
            if (!type.IsSerializable) throw new ArgumentException(type.Name + " is not marked [Serializable]");
            object into = Activator.CreateInstance(type);
            foreach (FieldInfo field in type.GetFields(BindingFlags.Public | BindingFlags.Instance))
            {
                object given, value;
                if (!field.IsInitOnly && from.TryGetValue(field.Name, out given) && Convert(given, field.FieldType, out value))
                {
                    field.SetValue(into, value);
                }
            }

            return into;
        }

        private static bool Convert(object given, Type type, out object value)
        {
            value = null;
            if (type.IsArray && type.GetElementType().IsArray) return false; // JsonUtility has no arrays in arrays
            if (type.IsArray && given is List<object>)
            {
                var list = (List<object>)given;
                Array array = Array.CreateInstance(type.GetElementType(), list.Count);
                for (int i = 0; i < list.Count; i++)
                {
                    object item;
                    if (Convert(list[i], type.GetElementType(), out item)) array.SetValue(item, i);
                }

                value = array;
            }
            else if (type == typeof(string) && given is string) value = given;
            else if (type == typeof(bool) && given is bool) value = given;
            else if (type.IsPrimitive && type != typeof(bool) && given is double)
            {
                value = System.Convert.ChangeType(given, type, CultureInfo.InvariantCulture);
            }
            else if (type.IsClass && type != typeof(string) && given is Dictionary<string, object>)
            {
                value = Fill((Dictionary<string, object>)given, type);
            }

            return value != null;
        }

        private sealed class Reader
        {
            private readonly string text;
            private int at;

            public Reader(string text) { this.text = text; }

            public object Whole()
            {
                object value = Value();
                Space();
                if (at != text.Length) throw Error();
                return value;
            }

            private object Value()
            {
                Space();
                if (at >= text.Length) throw Error();
                char c = text[at];
                if (c == '{') return Object();
                if (c == '[') return List();
                if (c == '"') return String();
                if (Word("true")) return true;
                if (Word("false")) return false;
                if (Word("null")) return null;
                int start = at;
                while (at < text.Length && "+-.0123456789eE".IndexOf(text[at]) >= 0) at++;
                double number;
                string digits = text.Substring(start, at - start);
                if (!double.TryParse(digits, NumberStyles.Float, CultureInfo.InvariantCulture, out number)) throw Error();
                return number;
            }

            private Dictionary<string, object> Object()
            {
                var found = new Dictionary<string, object>();
                for (at++; ; )
                {
                    Space();
                    if (Word("}")) return found;
                    if (found.Count > 0 && !Word(",")) throw Error();
                    Space();
                    string key = String();
                    Space();
                    if (!Word(":")) throw Error();
                    found[key] = Value();
                }
            }

            private List<object> List()
            {
                var found = new List<object>();
                for (at++; ; )
                {
                    Space();
                    if (Word("]")) return found;
                    if (found.Count > 0 && !Word(",")) throw Error();
                    found.Add(Value());
                }
            }

            private string String()
            {
                var made = new StringBuilder();
                if (!Word("\"")) throw Error();
                for (; at < text.Length && text[at] != '"'; at++)
                {
                    if (text[at] != '\\')
                    {
                        made.Append(text[at]);
                        continue;
                    }

                    char c = text[++at];
                    if (c == 'u')
                    {
                        made.Append((char)int.Parse(text.Substring(at + 1, 4), NumberStyles.HexNumber));
                        at += 4;
                    }
                    else made.Append(c == 'n' ? '\n' : c == 't' ? '\t' : c == 'r' ? '\r' : c == 'b' ? '\b' : c == 'f' ? '\f' : c);
                }

                if (!Word("\"")) throw Error();
                return made.ToString();
            }

            private bool Word(string word)
            {
                if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0) return false;
                at += word.Length;
                return true;
            }

            private void Space() { while (at < text.Length && char.IsWhiteSpace(text[at])) at++; }

            private Exception Error() { return new ArgumentException("JSON parse error at character " + at); }
        }
    }
}
